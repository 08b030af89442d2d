//! Output of the build script: the compiled kernels as Rust statics, and checks of structure layouts.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use super::wgsl::{Compiled, Kind, compile, load};

/// A line of `permutations.txt`, or a module that it does not name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Permutation {
    /// Name of the kernel.
    pub name: String,
    /// Stem of the file it is compiled from.
    pub stem: String,
    pub flags: Vec<String>,
}

/// A compiled kernel.
pub struct Built {
    pub permutation: Permutation,
    /// The file as messages show it.
    pub file: String,
    pub compiled: Compiled,
}

/// Reads the table of permutations: each line `kernel = stem FLAG FLAG ...`, `#` starts a comment. A stem of `stems`
/// without any line is compiled once, under its own name and without flags.
pub fn permutations(table: &str, stems: &[String]) -> Result<Vec<Permutation>, String> {
    let mut list: Vec<Permutation> = Vec::new();
    for (number, line) in table.lines().enumerate().map(|(i, line)| (i + 1, line)) {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let fail = |message: String| format!("permutations.txt:{number}: {message}");
        let (name, rest) = line.split_once('=').ok_or_else(|| fail("write kernel = stem FLAG ...".into()))?;
        let name = name.trim().to_owned();
        let mut words = rest.split_whitespace().map(str::to_owned);
        let stem = words.next().ok_or_else(|| fail("no stem after =".into()))?;
        if !stems.contains(&stem) {
            return Err(fail(format!("there is no {stem}.wgsl")));
        }
        if list.iter().any(|other| other.name == name) {
            return Err(fail(format!("{name} is defined twice")));
        }
        list.push(Permutation { name, stem, flags: words.collect() });
    }
    for stem in stems {
        if list.iter().all(|other| other.stem != *stem) {
            if list.iter().any(|other| other.name == *stem) {
                return Err(format!("permutations.txt: {stem} is the name of a kernel of another file"));
            }
            list.push(Permutation { name: stem.clone(), stem: stem.clone(), flags: Vec::new() });
        }
    }
    list.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(list)
}

/// Compiles every kernel of a folder; `label` stands for it in messages.
pub fn build(dir: &Path, label: &str) -> Result<Vec<Built>, String> {
    let mut stems = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(|e| format!("{label}: {e}"))? {
        let path = entry.map_err(|e| format!("{label}: {e}"))?.path();
        if path.extension().is_some_and(|ext| ext == "wgsl") {
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            stems.push(stem.ok_or_else(|| format!("{label}: {} is not UTF-8", path.display()))?.to_owned());
        }
    }
    stems.sort();
    let table = match std::fs::read_to_string(dir.join("permutations.txt")) {
        Ok(table) => table,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(e) => return Err(format!("{label}/permutations.txt: {e}")),
    };
    let list = permutations(&table, &stems).map_err(|e| format!("{label}: {e}"))?;
    list.into_iter()
        .map(|permutation| {
            let flags: Vec<&str> = permutation.flags.iter().map(String::as_str).collect();
            let source = load(dir, label, &permutation.stem, &flags)?;
            Ok(Built { compiled: compile(&source)?, file: source.file, permutation })
        })
        .collect()
}

/// Rust text with one `pub static` for each kernel. SPIR-V is read from `OUT_DIR/{prefix}{name}.spv`, `.checked.spv` and `.texels.spv`.
pub fn emit_shaders(list: &[Built], prefix: &str) -> String {
    let mut text = String::new();
    for built in list {
        let Permutation { name, stem, flags } = &built.permutation;
        let compiled = &built.compiled;
        let binary = |suffix: &str| format!("include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{prefix}{name}{suffix}\"))");
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "/// `{file}`{with}.\npub static {upper}: Shader = Shader {{\n    name: {name:?},\n    \
             file: {file:?},\n    flags: &{flags:?},\n    entry_point: c{entry:?},\n    spirv: {spirv},\n    \
             spirv_checked: {checked},\n    spirv_texels: {texels},\n    workgroup_size: {size:?},\n    bindings: &[",
            file = built.file,
            with = if flags.is_empty() { String::new() } else { format!(" with {}", flags.join(", ")) },
            upper = name.to_uppercase(),
            entry = compiled.entry_point,
            spirv = binary(".spv"),
            checked = binary(".checked.spv"),
            texels = binary(".texels.spv"),
            size = compiled.workgroup_size,
        );
        for binding in &compiled.bindings {
            let kind = match binding.kind {
                Kind::Read => "StorageRead",
                Kind::ReadWrite => "StorageReadWrite",
                Kind::Image => "StorageImage",
                Kind::Layers => "ImageLayers",
                Kind::Sampled => "SampledImage",
            };
            let _ = write!(
                text,
                "\n        BindingInfo {{ name: {:?}, slot: {}, kind: BindingKind::{kind}, texel_bytes: {}, \
                 fixed_bytes: {} }},",
                binding.name, binding.slot, binding.texel_bytes, binding.fixed_bytes
            );
        }
        let _ = write!(
            text,
            "\n    ],\n    push_bytes: {},\n    interface: {:?},\n}};\n",
            compiled.push_bytes,
            compiled.interface()
        );
        debug_assert!(built.file.ends_with(&format!("{stem}.wgsl")));
    }
    if !list.is_empty() {
        let all: Vec<String> = list.iter().map(|built| format!("&{}", built.permutation.name.to_uppercase())).collect();
        let _ = write!(
            text,
            "/// All kernels.\n#[allow(dead_code, reason = \"not every folder's kernels are asked for as a whole\")]\n\
             pub static ALL: &[&Shader] = &[{}];\n",
            all.join(", ")
        );
    }
    text
}

/// Rust text with a `const` assertion for the size of each structure and the offset of each member. The Rust
/// structures of the same names must be in scope where it is included. The same structure in several files is checked
/// once for each different layout, so of two kernels that disagree one fails.
pub fn emit_layout_checks(list: &[Built]) -> String {
    let mut text = String::new();
    let mut seen = BTreeSet::new();
    for built in list {
        for layout in &built.compiled.structs {
            if !seen.insert(format!("{layout:?}")) {
                continue;
            }
            let (name, file) = (&layout.name, &built.file);
            for (member, offset) in &layout.members {
                let _ = writeln!(
                    text,
                    "const _: () = assert!(core::mem::offset_of!({name}, {member}) == {offset}, \
                     \"{name}.{member}: offset {offset} in {file}\");"
                );
            }
            let _ = writeln!(
                text,
                "const _: () = assert!(core::mem::size_of::<{name}>() == {size}, \"{name}: {size} bytes in {file}\");",
                size = layout.size
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const SHADE: &str = "\
#include \"light.wgsl\"
#include \"light.wgsl\"
struct ShadePush { count: u32, scale: f32 }
var<immediate> push: ShadePush;
@group(0) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;
@group(0) @binding(0) var<storage, read> lights: LightList;
#if FILM
@group(0) @binding(1) var film: texture_storage_2d<rgba32float, write>;
#endif
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= push.count { return; }
    let light = lights.items[id.x];
    radiance[id.x] = vec4<f32>(light.normal * push.scale, light.power);
#if FILM
    textureStore(film, vec2<i32>(i32(id.x), 0), vec4<f32>(light.normal, 1.0));
#else
    radiance[id.x].w = 0.0;
#endif
}
";
    const LIGHT: &str = "\
struct Light { position: vec3<f32>, power: f32, normal: vec3<f32> }
struct LightList { count: u32, items: array<Light> }
";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("include")).unwrap();
        for (name, text) in files {
            fs::write(dir.path().join(name), text).unwrap();
        }
        dir
    }

    /// Words of OpVariable in the kernel of a function with an array of some length: five with initial value, four without.
    fn variables_of_array(length: u32) -> Vec<usize> {
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
            @compute @workgroup_size(1) fn main(@builtin(local_invocation_index) lane: u32) {{
                var kept: array<u32, {length}>;
                for (var i = 0u; i < {length}u; i += 1u) {{ kept[i] = i * lane; }}
                out[lane] = kept[lane];
            }}"
        );
        let dir = folder(&[("a.wgsl", &text)]);
        let code = &build(dir.path(), "shaders").unwrap()[0].compiled.spirv;
        let (mut at, mut found) = (5, Vec::new());
        while at < code.len() {
            let words = (code[at] >> 16) as usize;
            let is_function_variable = code[at] & 0xffff == 59 && code[at + 3] == 7;
            found.extend(is_function_variable.then_some(words));
            at += words;
        }
        found
    }

    #[test]
    fn only_large_arrays_start_without_zeros() {
        let (small, large) = (variables_of_array(64), variables_of_array(65));
        assert_eq!(small.len(), large.len());
        let changed: Vec<_> = small.iter().zip(&large).filter(|(a, b)| a != b).collect();
        assert_eq!(changed, [(&5, &4)], "the array alone: {small:?}, {large:?}");
    }

    #[test]
    fn layout_checks_name_the_member_and_the_file() {
        let dir = folder(&[("shade.wgsl", SHADE), ("include/light.wgsl", LIGHT), ("permutations.txt", "")]);
        // Without its flag named anywhere the film is left out.
        let built = build(dir.path(), "shaders").unwrap();
        let text = emit_layout_checks(&built);
        for expected in [
            "offset_of!(Light, normal) == 16, \"Light.normal: offset 16 in shaders/shade.wgsl\"",
            "offset_of!(Light, power) == 12, \"Light.power: offset 12 in shaders/shade.wgsl\"",
            "size_of::<Light>() == 32, \"Light: 32 bytes in shaders/shade.wgsl\"",
            "offset_of!(LightList, count) == 0",
            "size_of::<LightList>() == 16, \"LightList: 16 bytes in shaders/shade.wgsl\"",
            "size_of::<ShadePush>() == 8",
        ] {
            assert!(text.contains(expected), "{expected}\nis not in\n{text}");
        }
        assert!(!text.contains("items"), "a runtime-sized array has no Rust member:\n{text}");
        assert_eq!(text.matches("size_of::<Light>").count(), 1);
    }

    #[test]
    fn permutations_give_a_static_each() {
        let table = "# kernels\nshade = shade\nshade_film = shade FILM\n";
        let dir = folder(&[("shade.wgsl", SHADE), ("include/light.wgsl", LIGHT), ("permutations.txt", table)]);
        let built = build(dir.path(), "shaders").unwrap();
        let text = emit_shaders(&built, "kernel-");
        for expected in [
            "pub static SHADE: Shader",
            "pub static SHADE_FILM: Shader",
            "flags: &[\"FILM\"]",
            "workgroup_size: [64, 1, 1]",
            "push_bytes: 8",
            "BindingInfo { name: \"lights\", slot: 0, kind: BindingKind::StorageRead, texel_bytes: 0, fixed_bytes: 16 }",
            "BindingInfo { name: \"film\", slot: 1, kind: BindingKind::StorageImage, texel_bytes: 0, fixed_bytes: 0 }",
            "BindingInfo { name: \"radiance\", slot: 2, kind: BindingKind::StorageReadWrite, texel_bytes: 0, fixed_bytes: 0 }",
            "/kernel-shade_film.checked.spv",
            "pub static ALL: &[&Shader] = &[&SHADE, &SHADE_FILM];",
        ] {
            assert!(text.contains(expected), "{expected}\nis not in\n{text}");
        }
        assert_ne!(built[0].compiled.spirv, built[0].compiled.spirv_checked);
        assert_eq!(built[0].compiled.spirv[1], 0x0001_0300, "SPIR-V 1.3");
    }

    #[test]
    fn an_empty_folder_gives_nothing() {
        let dir = folder(&[]);
        let built = build(dir.path(), "shaders").unwrap();
        assert_eq!(emit_shaders(&built, ""), "");
        assert_eq!(emit_layout_checks(&built), "");
    }

    #[test]
    fn errors_name_file_and_line() {
        let build_error = |files: &[(&str, &str)]| match build(folder(files).path(), "shaders") {
            Ok(_) => panic!("{files:?} compiled"),
            Err(message) => message,
        };
        // The mistake stands on line 2 of the included file, which is line 3 of the joined text.
        let parse = build_error(&[
            ("a.wgsl", "// a\n#include \"b.wgsl\"\n@compute @workgroup_size(1) fn main() {}\n"),
            ("include/b.wgsl", "// b\nfn f() -> u32 { return nothing; }\n"),
        ]);
        assert!(parse.starts_with("shaders/include/b.wgsl:2:"), "{parse}");
        let valid = build_error(&[("a.wgsl", "@compute @workgroup_size(1)\nfn main() -> u32 {\n  return 1u;\n}\n")]);
        assert!(valid.starts_with("shaders/a.wgsl:"), "{valid}");
        let missing = build_error(&[("a.wgsl", "\n#include \"b.wgsl\"\n")]);
        assert!(missing.starts_with("shaders/include/b.wgsl: ") && missing.contains("shaders/a.wgsl:2"), "{missing}");
        let open = build_error(&[("a.wgsl", "\n#if X\n")]);
        assert!(open.starts_with("shaders/a.wgsl:2: #if without #endif"), "{open}");
        let group = build_error(&[(
            "a.wgsl",
            "@group(1) @binding(0) var<storage, read_write> x: array<u32>;\n@compute @workgroup_size(1) fn main() { x[0] = 1u; }\n",
        )]);
        assert!(group.starts_with("shaders/a.wgsl:1:") && group.contains("@group(0)"), "{group}");
        let flag = build_error(&[
            ("a.wgsl", "@compute @workgroup_size(1) fn main() {}\n"),
            ("permutations.txt", "a = a TYPO\n"),
        ]);
        assert!(flag.contains("TYPO"), "{flag}");
    }

    #[test]
    fn the_table_of_permutations_is_checked() {
        let stems = ["a".to_owned(), "b".to_owned()];
        let names =
            |table: &str| permutations(table, &stems).map(|list| list.into_iter().map(|p| p.name).collect::<Vec<_>>());
        assert_eq!(names("").unwrap(), ["a", "b"]);
        assert_eq!(names("x = a F\ny = a G # two\n").unwrap(), ["b", "x", "y"]);
        assert!(names("x = c").unwrap_err().starts_with("permutations.txt:1: there is no c.wgsl"));
        assert!(names("x = a\nx = b").unwrap_err().starts_with("permutations.txt:2: x is defined twice"));
        assert!(names("b = a").is_err());
    }
}
