//! Changes to the SPIR-V that naga writes, where drivers or the rules of Vulkan want something else.
//!
//! The build script compiles this file too, so it depends on nothing else in the crate.

use std::collections::{HashMap, HashSet};

const HEADER_WORDS: usize = 5;
/// Where the header has the number above all ids.
const BOUND: usize = 3;

// Numbers of the SPIR-V specification: operations, storage classes, decorations.
const TYPE_ARRAY: u32 = 28;
const TYPE_STRUCT: u32 = 30;
const TYPE_POINTER: u32 = 32;
const CONSTANT: u32 = 43;
const VARIABLE: u32 = 59;
const DECORATE: u32 = 71;
const WORKGROUP: u32 = 4;
const FUNCTION: u32 = 7;
const ARRAY_STRIDE: u32 = 6;

/// The header of a module, to begin a changed one with.
pub fn header(code: &[u32]) -> Vec<u32> {
    code[..HEADER_WORDS].to_vec()
}

/// The instructions of a module: operation, and all words with the first.
pub fn instructions(code: &[u32]) -> impl Iterator<Item = (u32, &[u32])> {
    let mut rest = &code[HEADER_WORDS..];
    std::iter::from_fn(move || {
        let first = *rest.first()?;
        let (instruction, after) = rest.split_at(((first >> 16) as usize).clamp(1, rest.len()));
        rest = after;
        Some((first & 0xffff, instruction))
    })
}

/// Longest array of a function whose elements start as zeros.
const ZEROED: u32 = 64;

/// Takes the initial zeros away from the variables of functions that are arrays of more than [`ZEROED`] elements. A driver that
/// writes them one by one compiles that for seconds (lavapipe). So a kernel reads no element of such an array before it has written it.
pub fn without_zeros(code: &[u32]) -> Vec<u32> {
    let (mut constants, mut arrays, mut pointers) = (HashMap::new(), HashSet::new(), HashSet::new());
    let mut kept = header(code);
    for (operation, instruction) in instructions(code) {
        match *instruction {
            [_, _, id, value] if operation == CONSTANT => {
                constants.insert(id, value);
            }
            [_, id, _, length] if operation == TYPE_ARRAY && constants.get(&length).is_some_and(|n| *n > ZEROED) => {
                arrays.insert(id);
            }
            [_, id, FUNCTION, of] if operation == TYPE_POINTER && arrays.contains(&of) => {
                pointers.insert(id);
            }
            [_, pointer, id, FUNCTION, _] if operation == VARIABLE && pointers.contains(&pointer) => {
                kept.extend([4 << 16 | VARIABLE, pointer, id, FUNCTION]);
                continue;
            }
            _ => {}
        }
        kept.extend(instruction);
    }
    kept
}

/// Gives the arrays that workgroups share types without strides. Vulkan forbids the layouts of buffers in memory of workgroups
/// (VUID-StandaloneSpirv-None-10684); naga gives every array one, and some drivers refuse such a kernel. Only elements of these arrays may be
/// loaded and stored, not arrays as a whole, whose type would be the other one.
///
/// # Errors
/// Elements that have a layout themselves: structures and arrays.
pub fn without_strides_in_workgroups(code: &[u32]) -> Result<Vec<u32>, String> {
    let (mut strided, mut arrays, mut with_layout) = (HashSet::new(), HashMap::new(), HashSet::new());
    let mut changed = header(code);
    for (operation, instruction) in instructions(code) {
        match *instruction {
            [_, id, ARRAY_STRIDE, _] if operation == DECORATE => {
                strided.insert(id);
            }
            [_, id, ..] if operation == TYPE_STRUCT => {
                with_layout.insert(id);
            }
            [_, id, element, length] if operation == TYPE_ARRAY && strided.contains(&id) => {
                arrays.insert(id, (element, length));
                with_layout.insert(id);
            }
            [first, pointer, WORKGROUP, of] if operation == TYPE_POINTER && with_layout.contains(&of) => {
                let Some(&(element, length)) = arrays.get(&of).filter(|(element, _)| !with_layout.contains(element))
                else {
                    return Err("variables of workgroups are numbers, vectors and arrays of them".into());
                };
                let array = changed[BOUND];
                changed[BOUND] += 1;
                changed.extend([4 << 16 | TYPE_ARRAY, array, element, length]);
                changed.extend([first, pointer, WORKGROUP, array]);
                continue;
            }
            _ => {}
        }
        changed.extend(instruction);
    }
    Ok(changed)
}

/// The types of variables of workgroups that have a layout, by their ids.
#[cfg(test)]
pub fn layouts_in_workgroups(code: &[u32]) -> Vec<u32> {
    let (mut decorated, mut found) = (HashSet::new(), Vec::new());
    for (operation, instruction) in instructions(code) {
        match *instruction {
            [_, id, ARRAY_STRIDE, _] if operation == DECORATE => {
                decorated.insert(id);
            }
            [_, id, ..] if operation == TYPE_STRUCT => {
                decorated.insert(id);
            }
            [_, _, WORKGROUP, of] if operation == TYPE_POINTER && decorated.contains(&of) => found.push(of),
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The SPIR-V that naga writes for a kernel with these variables and this body.
    fn written(variables: &str, body: &str) -> Vec<u32> {
        let text = format!(
            "{variables}
            @group(0) @binding(0) var<storage, read_write> out: array<u32>;
            @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) lane: u32) {{ {body} }}"
        );
        let module = naga::front::wgsl::parse_str(&text).unwrap();
        let info = naga::valid::Validator::new(Default::default(), Default::default()).validate(&module).unwrap();
        let zero_initialize_workgroup_memory = naga::back::spv::ZeroInitializeWorkgroupMemoryMode::None;
        let options = naga::back::spv::Options { zero_initialize_workgroup_memory, ..Default::default() };
        naga::back::spv::write_vec(&module, &info, &options, None).unwrap()
    }

    #[test]
    fn arrays_of_workgroups_have_types_of_their_own() {
        // One array of the same type is a variable of the function, whose type keeps its stride.
        let code = written(
            "var<workgroup> shared_sums: array<u32, 64>; var<workgroup> count: atomic<u32>;",
            "var own: array<u32, 64>; own[lane] = lane; shared_sums[lane] = own[63u - lane] + atomicAdd(&count, 1u);
             workgroupBarrier(); out[lane] = shared_sums[63u - lane];",
        );
        assert_eq!(layouts_in_workgroups(&code).len(), 1, "naga gives the array a stride");
        let changed = without_strides_in_workgroups(&code).unwrap();
        assert!(layouts_in_workgroups(&changed).is_empty());
        assert_eq!(changed.len(), code.len() + 4, "one more type");
        assert_eq!(changed[BOUND], code[BOUND] + 1);
        let pointers = |code: &[u32], class: u32| -> Vec<u32> {
            let found = instructions(code).filter(|(operation, words)| *operation == TYPE_POINTER && words[2] == class);
            found.map(|(_, words)| words[3]).collect()
        };
        assert_eq!(pointers(&changed, FUNCTION), pointers(&code, FUNCTION));
        assert_eq!(without_strides_in_workgroups(&changed).unwrap(), changed, "nothing is left to change");
    }

    #[test]
    fn structures_of_workgroups_are_refused() {
        let code = written(
            "struct Pair { a: u32, b: vec2<u32> } var<workgroup> pairs: array<Pair, 64>;",
            "pairs[lane].a = lane; workgroupBarrier(); out[lane] = pairs[63u - lane].a;",
        );
        let error = without_strides_in_workgroups(&code).unwrap_err();
        assert!(error.contains("variables of workgroups"), "{error}");
    }

    #[test]
    fn no_kernel_has_layouts_in_workgroups() {
        let mut shared = 0;
        for shader in super::super::shaders::ALL {
            for bytes in [shader.spirv, shader.spirv_checked, shader.spirv_texels] {
                let code: Vec<u32> =
                    bytes.chunks_exact(4).map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect();
                assert!(layouts_in_workgroups(&code).is_empty(), "{}", shader.name);
                let variables = instructions(&code).filter(|(operation, _)| *operation == VARIABLE);
                shared += variables.filter(|(_, words)| words[3] == WORKGROUP).count();
            }
        }
        assert!(shared > 10, "{shared} variables of workgroups");
    }
}
