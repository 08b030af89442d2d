//! Read-only arrays of a kernel as texel buffers, for drivers that run on the processor.
//!
//! lavapipe (Mesa 22.3) reads an element of a storage buffer within any `if` or loop by a loop over the lanes, some 540 cycles for a vector
//! of four in eight lanes, and a texel by straight-line code, some 90. So `name[i]` of each array that a kernel only reads becomes
//! `element_of_name(i)`, a function that fetches the texels of an element from `texture_1d<u32>` and puts their bits together, and the SPIR-V is
//! changed from images of one dimension, which WGSL has, to buffers of texels, which it lacks. The data does not change.
//!
//! The build script compiles this file too (through `#[path]`), so it depends on nothing else in the crate.

use std::collections::HashSet;
use std::fmt::Write as _;

use naga::{AddressSpace, ArraySize, Handle, Module, ScalarKind, StorageAccess, Type, TypeInner};

/// The text with texel buffers, and for each of them its name and bytes of a texel: 4, 8 or 16 (integers of 32 bits).
pub struct Texels {
    pub text: String,
    pub buffers: Vec<(String, u32)>,
}

/// Rewrites the text of a module. Arrays stay as they are whose name stands for something else too, or for the array as a whole.
pub fn rewrite(text: &str, module: &Module) -> Texels {
    let mut texels = Texels { text: text.to_owned(), buffers: Vec::new() };
    let mut functions = String::new();
    for (_, variable) in module.global_variables.iter() {
        let (Some(name), Some(_)) = (&variable.name, &variable.binding) else { continue };
        let TypeInner::Array { base, stride, size } = module.types[variable.ty].inner else { continue };
        let reads_only = variable.space == AddressSpace::Storage { access: StorageAccess::LOAD };
        if !reads_only || size != ArraySize::Dynamic || names_a_local(module, name) {
            continue;
        }
        let bytes = [16, 8, 4].into_iter().find(|bytes| stride % bytes == 0).unwrap_or(4);
        let Some(value) = value(module, base, 0, bytes) else { continue };
        let Some(rewritten) = rewrite_variable(&texels.text, name) else { continue };
        let texels_each = stride / bytes;
        // Writing to a String cannot fail.
        let _ =
            write!(functions, "fn element_of_{name}(i: u32) -> {} {{ ", type_name(module, base).unwrap_or_default());
        for k in 0..texels_each {
            let _ = write!(functions, "let t{k} = textureLoad({name}, i * {texels_each}u + {k}u, 0); ");
        }
        let _ = writeln!(functions, "return {value}; }}");
        texels.text = rewritten;
        texels.buffers.push((name.clone(), bytes));
    }
    texels.text.push_str(&functions);
    texels
}

/// Whether a function has an argument or a variable of this name.
fn names_a_local(module: &Module, name: &str) -> bool {
    let functions = module.functions.iter().map(|(_, function)| function);
    functions.chain(module.entry_points.iter().map(|entry| &entry.function)).any(|function| {
        function.arguments.iter().any(|argument| argument.name.as_deref() == Some(name))
            || function.local_variables.iter().any(|(_, local)| local.name.as_deref() == Some(name))
            || function.named_expressions.values().any(|given| given == name)
    })
}

fn scalar_name(scalar: naga::Scalar) -> Option<&'static str> {
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => Some("f32"),
        (ScalarKind::Uint, 4) => Some("u32"),
        (ScalarKind::Sint, 4) => Some("i32"),
        _ => None,
    }
}

/// A type in WGSL.
fn type_name(module: &Module, ty: Handle<Type>) -> Option<String> {
    Some(match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => scalar_name(*scalar)?.to_owned(),
        TypeInner::Vector { size, scalar } => format!("vec{}<{}>", *size as u32, scalar_name(*scalar)?),
        TypeInner::Array { base, size: ArraySize::Constant(length), .. } => {
            format!("array<{}, {length}>", type_name(module, *base)?)
        }
        TypeInner::Struct { .. } => module.types[ty].name.clone()?,
        _ => return None,
    })
}

/// The value of a type at `offset` bytes into an element whose texels are `t0`, `t1`, ...; `None` for types that are not made of words.
fn value(module: &Module, ty: Handle<Type>, offset: u32, bytes: u32) -> Option<String> {
    let word = |at: u32| format!("t{}.{}", at / bytes, ["x", "y", "z", "w"][(at % bytes / 4) as usize]);
    let parts: Vec<String> = match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => return Some(format!("bitcast<{}>({})", scalar_name(*scalar)?, word(offset))),
        TypeInner::Vector { size, scalar } => {
            scalar_name(*scalar)?;
            let words: Vec<String> = (0..*size as u32).map(|k| word(offset + 4 * k)).collect();
            let (name, size) = (type_name(module, ty)?, words.len());
            return Some(format!("bitcast<{name}>(vec{size}<u32>({}))", words.join(", ")));
        }
        TypeInner::Array { base, size: ArraySize::Constant(length), stride } => {
            (0..length.get()).map(|k| value(module, *base, offset + k * stride, bytes)).collect::<Option<_>>()?
        }
        TypeInner::Struct { members, .. } => {
            members.iter().map(|m| value(module, m.ty, offset + m.offset, bytes)).collect::<Option<_>>()?
        }
        _ => return None,
    };
    Some(format!("{}({})", type_name(module, ty)?, parts.join(", ")))
}

/// Places of a name in a text as a word, outside of comments and not as a member of a structure.
fn places(text: &str, name: &str) -> Vec<usize> {
    let is_word = |c: Option<char>| c.is_some_and(|c| c.is_ascii_alphanumeric() || c == '_');
    text.match_indices(name)
        .map(|(at, _)| at)
        .filter(|&at| {
            let before = text[..at].chars().next_back();
            let line = text[..at].rfind('\n').map_or(0, |end| end + 1);
            !is_word(before)
                && before != Some('.')
                && !is_word(text[at + name.len()..].chars().next())
                && !text[line..at].contains("//")
        })
        .collect()
}

/// Declares the variable as an image, and turns `name[index]` into `element_of_name(u32(index))`. `None` if it is used in another way.
fn rewrite_variable(text: &str, name: &str) -> Option<String> {
    const DECLARED: &str = "var<storage, read> ";
    // Places and what stands there instead: the word, and the bracket that closes its index.
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    for at in places(text, name) {
        let rest = &text[at + name.len()..];
        if text[..at].ends_with(DECLARED) {
            let end = at + text[at..].find(';')?;
            edits.push((at - DECLARED.len()..end, format!("var {name}: texture_1d<u32>")));
        } else if rest.starts_with('[') && !text[..at].ends_with('&') {
            let open = at + name.len();
            let close = open + closing_bracket(&text[open..])?;
            edits.push((at..open + 1, format!("element_of_{name}(u32(")));
            edits.push((close..close + 1, "))".to_owned()));
        } else if !rest.trim_start().starts_with(':') {
            return None;
        }
    }
    edits.sort_by_key(|(range, _)| range.start);
    let mut rewritten = String::with_capacity(text.len());
    let mut from = 0;
    for (range, new) in edits {
        rewritten.push_str(&text[from..range.start]);
        rewritten.push_str(&new);
        from = range.end;
    }
    rewritten.push_str(&text[from..]);
    Some(rewritten)
}

/// Index of the bracket that closes the first one of a text.
fn closing_bracket(text: &str) -> Option<usize> {
    let mut open = 0;
    for (at, c) in text.char_indices() {
        match c {
            '[' => open += 1,
            ']' if open == 1 => return Some(at),
            ']' => open -= 1,
            _ => {}
        }
    }
    None
}

/// Turns images of one dimension that are read without a sampler into texel buffers.
pub fn images_to_buffers(code: Vec<u32>) -> Vec<u32> {
    const HEADER_WORDS: usize = 5;
    // Numbers of the SPIR-V specification: operations, capabilities, dimensions.
    const CAPABILITY: u32 = 17;
    const TYPE_IMAGE: u32 = 25;
    const LOAD: u32 = 61;
    const IMAGE_FETCH: u32 = 95;
    const SAMPLED_1D: u32 = 43;
    const SAMPLED_BUFFER: u32 = 46;
    const DIM_1D: u32 = 0;
    const DIM_BUFFER: u32 = 5;
    let (mut types, mut loaded) = (HashSet::new(), HashSet::new());
    let mut changed = code[..HEADER_WORDS].to_vec();
    let mut rest = &code[HEADER_WORDS..];
    while let Some(&first) = rest.first() {
        let (words, operation) = ((first >> 16) as usize, first & 0xffff);
        let (instruction, after) = rest.split_at(words.clamp(1, rest.len()));
        rest = after;
        match (operation, instruction) {
            (CAPABILITY, [first, SAMPLED_1D]) => changed.extend([*first, SAMPLED_BUFFER]),
            (TYPE_IMAGE, [first, id, sampled, DIM_1D, kind @ ..]) => {
                types.insert(*id);
                changed.extend([*first, *id, *sampled, DIM_BUFFER]);
                changed.extend(kind);
            }
            // Without the level of detail.
            (IMAGE_FETCH, [_, ty, id, image, at, ..]) if loaded.contains(image) => {
                changed.extend([5 << 16 | IMAGE_FETCH, *ty, *id, *image, *at]);
            }
            _ => {
                if let (LOAD, [_, ty, id, ..]) = (operation, instruction)
                    && types.contains(ty)
                {
                    loaded.insert(*id);
                }
                changed.extend(instruction);
            }
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: &str = "
        struct Inner { a: vec3<f32>, b: u32 }
        struct Record { inner: Inner, pair: vec2<i32>, few: array<f32, 2> }
        // words[3] of a comment, with a bracket ]
        @group(0) @binding(0) var<storage, read> words: array<u32>;
        @group(0) @binding(1) var<storage, read> pairs: array<vec2<f32>>;
        @group(0) @binding(2) var<storage, read> records: array<Record>;
        @group(0) @binding(3) var<storage, read> counted: array<u32>;
        @group(0) @binding(4) var<storage, read> argument: array<f32>;
        @group(0) @binding(5) var<storage, read_write> out: array<f32>;
        fn twice(argument: f32) -> f32 { return 2.0 * argument; }
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {
            let at = words[words[id.x] + arrayLength(&counted)];
            let record = records[at];
            out[id.x] = twice(pairs[i32(at)].y + records[at].few[1]) + record.inner.a.z + argument[0] + f32(counted[1]);
        }";

    fn rewritten() -> Texels {
        rewrite(KERNEL, &naga::front::wgsl::parse_str(KERNEL).unwrap())
    }

    #[test]
    fn arrays_that_are_read_by_element_become_texels() {
        let texels = rewritten();
        let named = |name: &str, bytes| (name.to_owned(), bytes);
        assert_eq!(texels.buffers, [named("words", 4), named("pairs", 8), named("records", 16)]);
        for expected in [
            "var words: texture_1d<u32>;",
            "element_of_words(u32(element_of_words(u32(id.x)) + arrayLength(&counted)))",
            "element_of_pairs(u32(i32(at))).y + element_of_records(u32(at)).few[1]",
            "return Record(Inner(bitcast<vec3<f32>>(vec3<u32>(t0.x, t0.y, t0.z)), bitcast<u32>(t0.w)), \
             bitcast<vec2<i32>>(vec2<u32>(t1.x, t1.y)), array<f32, 2>(bitcast<f32>(t1.z), bitcast<f32>(t1.w)));",
            "var<storage, read> counted: array<u32>;",
            "var<storage, read> argument: array<f32>;",
            "// words[3] of a comment",
        ] {
            assert!(texels.text.contains(expected), "{expected}\nis not in\n{}", texels.text);
        }
        let before = KERNEL.lines().count();
        assert_eq!(texels.text.lines().count(), before + 2, "the functions follow the last line");
    }

    #[test]
    fn images_become_buffers_of_texels() {
        let module = naga::front::wgsl::parse_str(&rewritten().text).unwrap();
        let mut validator = naga::valid::Validator::new(Default::default(), Default::default());
        let info = validator.validate(&module).unwrap();
        let code = naga::back::spv::write_vec(&module, &info, &Default::default(), None).unwrap();
        let lengths = |code: &[u32], operation: u32| {
            let (mut at, mut found) = (5, Vec::new());
            while at < code.len() {
                let words = (code[at] >> 16) as usize;
                found.extend((code[at] & 0xffff == operation).then(|| code[at..at + words].to_vec()));
                at += words;
            }
            found
        };
        let changed = images_to_buffers(code.clone());
        let fetches = lengths(&code, 95).len();
        assert!(fetches > 3 && lengths(&code, 95).iter().all(|fetch| fetch.len() == 7));
        assert_eq!(lengths(&changed, 95).len(), fetches);
        assert!(lengths(&changed, 95).iter().all(|fetch| fetch.len() == 5), "no level of detail");
        assert!(lengths(&changed, 25).iter().all(|image| image[3] == 5), "of dimension Buffer");
        let capabilities: Vec<u32> = lengths(&changed, 17).iter().map(|capability| capability[1]).collect();
        assert!(capabilities.contains(&46) && !capabilities.contains(&43), "{capabilities:?}");
    }
}
