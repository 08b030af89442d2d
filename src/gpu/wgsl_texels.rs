//! Arrays of a kernel as texel buffers, for drivers that run on the processor.
//!
//! lavapipe (Mesa 22.3) reads or writes an element of a storage buffer within any `if` or loop by a loop over the lanes for each of its
//! words, some 540 cycles for a vector of four in eight lanes. It reads a texel by straight-line code, some 90, and writes one by a single
//! loop. So `name[i]` becomes `element_of_name(i)`, a function that fetches the texels of an element from an image of one dimension and
//! puts their bits together, `name[i] = v` becomes `set_name(i, v)`, and the SPIR-V is changed from images of one dimension, which WGSL
//! has, to buffers of texels, which it lacks. The data does not change.
//!
//! The build script compiles this file too (through `#[path]`), so it depends on nothing else in the crate but [`super::wgsl_spirv`].

use std::collections::{BTreeSet, HashSet};
use std::fmt::Write as _;

use super::wgsl_spirv;
use naga::{AddressSpace, ArraySize, Handle, Module, ScalarKind, StorageAccess, Type, TypeInner};

/// The text with texel buffers, and for each of them its name and bytes of a texel: 4, 8 or 16 (integers of 32 bits).
pub struct Texels {
    pub text: String,
    pub buffers: Vec<(String, u32)>,
}

/// Rewrites the text of a module. Arrays stay as they are whose name stands for something else too, that are used as a whole or whose
/// elements are written in parts, and arrays that are written where invocations wait for each other.
pub fn rewrite(text: &str, module: &Module) -> Texels {
    let mut texels = Texels { text: text.to_owned(), buffers: Vec::new() };
    let mut functions = String::new();
    let waits = text.contains("Barrier(");
    for (_, variable) in module.global_variables.iter() {
        let (Some(name), Some(_)) = (&variable.name, &variable.binding) else { continue };
        let TypeInner::Array { base, stride, size } = module.types[variable.ty].inner else { continue };
        let AddressSpace::Storage { access } = variable.space else { continue };
        let writes = access.contains(StorageAccess::STORE);
        if size != ArraySize::Dynamic || names_a_local(module, name) || (writes && waits) {
            continue;
        }
        // Texels of two words can be read by any device, and written by some.
        let sizes: &[u32] = if writes { &[16, 4] } else { &[16, 8, 4] };
        let bytes = sizes.iter().copied().find(|bytes| stride % bytes == 0).unwrap_or(4);
        let (Some(ty), Some(value)) = (type_name(module, base), value(module, base, 0, bytes)) else { continue };
        let Some(rewritten) = rewrite_variable(&texels.text, name, bytes) else { continue };
        let count = stride / bytes;
        // Writing to a String cannot fail.
        let _ = write!(functions, "fn element_of_{name}(i: u32) -> {ty} {{ ");
        let level = if writes { "" } else { ", 0" };
        for k in 0..count {
            let _ = write!(functions, "let t{k} = textureLoad({name}, i * {count}u + {k}u{level}); ");
        }
        let _ = writeln!(functions, "return {value}; }}");
        if writes {
            let mut words = vec!["0u".to_owned(); (stride / 4) as usize];
            set_words(module, base, 0, "v", &mut words);
            let _ = write!(functions, "fn set_{name}(i: u32, v: {ty}) {{ ");
            for (k, texel) in words.chunks(bytes as usize / 4).enumerate() {
                let texel = if let [word] = texel { word.clone() } else { texel.join(", ") };
                let _ = write!(functions, "textureStore({name}, i * {count}u + {k}u, vec4<u32>({texel})); ");
            }
            let _ = writeln!(functions, "}}");
        }
        for operator in rewritten.operators {
            let word = OPERATORS.iter().find(|(sign, _)| *sign == operator).map_or("", |(_, word)| word);
            let _ = writeln!(
                functions,
                "fn {word}_{name}(i: u32, v: {ty}) {{ set_{name}(i, element_of_{name}(i) {operator} v); }}"
            );
        }
        texels.text = rewritten.text;
        texels.buffers.push((name.clone(), bytes));
    }
    // On lines of their own, so that messages name the right ones.
    texels.text.push_str(if text.ends_with('\n') { "" } else { "\n" });
    texels.text.push_str(&functions);
    texels
}

/// Operators of assignments, and the word for each in the names of functions.
const OPERATORS: [(char, &str); 6] =
    [('+', "add_to"), ('-', "subtract_from"), ('*', "multiply"), ('|', "or_to"), ('&', "and_to"), ('^', "xor_to")];

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

/// Expressions for the words of a value `v` that lies `offset` bytes into an element.
fn set_words(module: &Module, ty: Handle<Type>, offset: u32, v: &str, words: &mut [String]) {
    match &module.types[ty].inner {
        TypeInner::Scalar(_) => words[(offset / 4) as usize] = format!("bitcast<u32>({v})"),
        TypeInner::Vector { size, .. } => {
            for (k, component) in ["x", "y", "z", "w"].into_iter().enumerate().take(*size as usize) {
                words[offset as usize / 4 + k] = format!("bitcast<u32>({v}.{component})");
            }
        }
        TypeInner::Array { base, size: ArraySize::Constant(length), stride } => {
            for k in 0..length.get() {
                set_words(module, *base, offset + k * stride, &format!("{v}[{k}]"), words);
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                let name = member.name.as_deref().unwrap_or_default();
                set_words(module, member.ty, offset + member.offset, &format!("{v}.{name}"), words);
            }
        }
        _ => {}
    }
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

/// A text with one variable rewritten, and the operators of its assignments.
struct Rewritten {
    text: String,
    operators: BTreeSet<char>,
}

/// Declares the variable as an image, and turns `name[index]` into `element_of_name(u32(index))` and `name[index] = v` into
/// `set_name(u32(index), v)`. `None` if it is used in another way.
fn rewrite_variable(text: &str, name: &str, bytes: u32) -> Option<Rewritten> {
    // Places and what stands there instead.
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    let mut operators = BTreeSet::new();
    for at in places(text, name) {
        let (before, rest) = (&text[..at], &text[at + name.len()..]);
        let declared = ["var<storage, read> ", "var<storage, read_write> "].into_iter().find(|d| before.ends_with(d));
        if let Some(declared) = declared {
            let end = at + text[at..].find(';')?;
            let image = match (declared.contains("write"), bytes) {
                (false, _) => "texture_1d<u32>",
                (true, 16) => "texture_storage_1d<rgba32uint, read_write>",
                (true, _) => "texture_storage_1d<r32uint, read_write>",
            };
            edits.push((at - declared.len()..end, format!("var {name}: {image}")));
        } else if rest.starts_with('[') && !before.ends_with('&') {
            let open = at + name.len();
            let close = open + closing_bracket(&text[open..])?;
            match assignment(&text[close + 1..])? {
                Use::Read => {
                    edits.push((at..open + 1, format!("element_of_{name}(u32(")));
                    edits.push((close..close + 1, "))".to_owned()));
                }
                Use::Write { operator, value, end } => {
                    let word = match operator {
                        Some(sign) => OPERATORS.iter().find(|(other, _)| *other == sign)?.1,
                        None => "set",
                    };
                    operators.extend(operator);
                    edits.push((at..open + 1, format!("{word}_{name}(u32(")));
                    edits.push((close..close + 1 + value, "),".to_owned()));
                    edits.push((close + 1 + end..close + 2 + end, ");".to_owned()));
                }
            }
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
    Some(Rewritten { text: rewritten, operators })
}

/// How an element is used.
enum Use {
    Read,
    /// Starts of the value and of the semicolon after it.
    Write {
        operator: Option<char>,
        value: usize,
        end: usize,
    },
}

/// The use of an element by the text after it. `None`: a part of it is written.
fn assignment(after: &str) -> Option<Use> {
    let trimmed = after.trim_start();
    let skipped = after.len() - trimmed.len();
    let mut signs = trimmed.chars();
    let (first, second, third) = (signs.next(), signs.next(), signs.next());
    let operator = match (first, second, third) {
        (Some('='), Some(other), _) if other != '=' => Some((None, 1)),
        (Some(sign), Some('='), Some(other)) if other != '=' && OPERATORS.iter().any(|(o, _)| *o == sign) => {
            Some((Some(sign), 2))
        }
        _ => None,
    };
    if let Some((operator, signs)) = operator {
        let end = semicolon(after)?;
        return Some(Use::Write { operator, value: skipped + signs, end });
    }
    // Of a member or a component: up to the end of the path.
    let path = trimmed.find(|c: char| !(c.is_ascii_alphanumeric() || "_.[]".contains(c))).unwrap_or(trimmed.len());
    let mut signs = trimmed[path..].trim_start().chars();
    let (first, second) = (signs.next(), signs.next());
    let writes = first == Some('=') && second != Some('=')
        || first.is_some_and(|sign| OPERATORS.iter().any(|(o, _)| *o == sign)) && second == Some('=');
    (!(trimmed.starts_with(['.', '[']) && writes)).then_some(Use::Read)
}

/// Index of the first semicolon outside of comments.
fn semicolon(text: &str) -> Option<usize> {
    let mut from = 0;
    for line in text.split_inclusive('\n') {
        let code = line.find("//").unwrap_or(line.len());
        if let Some(at) = line[..code].find(';') {
            return Some(from + at);
        }
        from += line.len();
    }
    None
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

/// Turns images of one dimension into texel buffers.
pub fn images_to_buffers(code: Vec<u32>) -> Vec<u32> {
    // Numbers of the SPIR-V specification: operations, capabilities, dimensions.
    const CAPABILITY: u32 = 17;
    const TYPE_IMAGE: u32 = 25;
    const LOAD: u32 = 61;
    const IMAGE_FETCH: u32 = 95;
    const SAMPLED_1D: u32 = 43;
    const IMAGE_1D: u32 = 44;
    const SAMPLED_BUFFER: u32 = 46;
    const IMAGE_BUFFER: u32 = 47;
    const DIM_1D: u32 = 0;
    const DIM_BUFFER: u32 = 5;
    let (mut types, mut loaded) = (HashSet::new(), HashSet::new());
    let mut changed = wgsl_spirv::header(&code);
    for (operation, instruction) in wgsl_spirv::instructions(&code) {
        match (operation, instruction) {
            (CAPABILITY, [first, SAMPLED_1D]) => changed.extend([*first, SAMPLED_BUFFER]),
            (CAPABILITY, [first, IMAGE_1D]) => changed.extend([*first, IMAGE_BUFFER]),
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
        @group(0) @binding(6) var<storage, read_write> kept: array<Record>;
        @group(0) @binding(7) var<storage, read_write> in_parts: array<vec4<f32>>;
        fn twice(argument: f32) -> f32 { return 2.0 * argument; }
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {
            let at = words[words[id.x] + arrayLength(&counted)];
            let record = records[at];
            out[id.x] = twice(pairs[i32(at)].y + records[at].few[1]) + record.inner.a.z + argument[0] + f32(counted[1]);
            out[at] += select(out[id.x], // of this one; or
                2.0, out[at] == 1.0);
            kept[at] = Record(kept[at].inner, vec2<i32>(1, 2), record.few);
            in_parts[at].y = in_parts[id.x].x;
        }";

    fn rewritten() -> Texels {
        rewrite(KERNEL, &naga::front::wgsl::parse_str(KERNEL).unwrap())
    }

    #[test]
    fn arrays_of_which_whole_elements_are_used_become_texels() {
        let texels = rewritten();
        let named = |name: &str, bytes| (name.to_owned(), bytes);
        assert_eq!(
            texels.buffers,
            [named("words", 4), named("pairs", 8), named("records", 16), named("out", 4), named("kept", 16)]
        );
        for expected in [
            "var words: texture_1d<u32>;",
            "element_of_words(u32(element_of_words(u32(id.x)) + arrayLength(&counted)))",
            "element_of_pairs(u32(i32(at))).y + element_of_records(u32(at)).few[1]",
            "return Record(Inner(bitcast<vec3<f32>>(vec3<u32>(t0.x, t0.y, t0.z)), bitcast<u32>(t0.w)), \
             bitcast<vec2<i32>>(vec2<u32>(t1.x, t1.y)), array<f32, 2>(bitcast<f32>(t1.z), bitcast<f32>(t1.w)));",
            "var out: texture_storage_1d<r32uint, read_write>;",
            "set_out(u32(id.x), twice(",
            "add_to_out(u32(at), select(element_of_out(u32(id.x)), // of this one; or",
            "2.0, element_of_out(u32(at)) == 1.0));",
            "fn add_to_out(i: u32, v: f32) { set_out(i, element_of_out(i) + v); }",
            "textureStore(out, i * 1u + 0u, vec4<u32>(bitcast<u32>(v)));",
            "var kept: texture_storage_1d<rgba32uint, read_write>;",
            "set_kept(u32(at), Record(element_of_kept(u32(at)).inner, vec2<i32>(1, 2), record.few));",
            "textureStore(kept, i * 2u + 0u, vec4<u32>(bitcast<u32>(v.inner.a.x), bitcast<u32>(v.inner.a.y), \
             bitcast<u32>(v.inner.a.z), bitcast<u32>(v.inner.b)));",
            "var<storage, read_write> in_parts: array<vec4<f32>>;",
            "var<storage, read> counted: array<u32>;",
            "var<storage, read> argument: array<f32>;",
            "// words[3] of a comment",
        ] {
            assert!(texels.text.contains(expected), "{expected}\nis not in\n{}", texels.text);
        }
        let before = KERNEL.lines().count();
        assert_eq!(texels.text.lines().count(), before + 8, "the functions follow the last line");
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
        let has = |numbers: [u32; 2]| numbers.map(|number| capabilities.contains(&number));
        assert_eq!((has([46, 47]), has([43, 44])), ([true, true], [false, false]), "{capabilities:?}");
    }
}
