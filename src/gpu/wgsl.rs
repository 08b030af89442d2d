//! WGSL files to SPIR-V: includes, conditionals, naga, reflection.
//!
//! The build script compiles this file too (through `#[path]`), so it depends on nothing else in the crate but
//! [`super::wgsl_parameters`], [`super::wgsl_spirv`] and [`super::wgsl_texels`].
//!
//! Directives stand alone on a line: `#include "file.wgsl"` (from `include/`, at most once per module), `#if FLAG`, `#else`,
//! `#endif`. `permutations.txt` lists the flags of each module.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use super::{wgsl_parameters, wgsl_spirv, wgsl_texels};

/// Text with resolved directives, and the origin of each line.
#[derive(Clone)]
pub struct Source {
    /// The module's own file as messages show it, such as `shaders/shade.wgsl`.
    pub file: String,
    text: String,
    /// For each line of `text`: index into `files`, line from 1.
    lines: Vec<(usize, usize)>,
    files: Vec<String>,
}

/// Kind of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `var<storage, read>`
    Read,
    /// `var<storage, read_write>`
    ReadWrite,
    /// `texture_storage_2d`
    Image,
    /// `texture_2d_array`
    Layers,
    /// `texture_2d`
    Sampled,
}

/// One variable of group 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    pub name: String,
    pub slot: u32,
    pub kind: Kind,
    /// Bytes of a texel in `spirv_texels`; 0: a storage buffer or an image there too.
    pub texel_bytes: u32,
    /// Bytes in front of a runtime-sized array, or all bytes where there is none; 0 of an image.
    pub fixed_bytes: u32,
}

/// Size and offsets of a structure that the host fills or reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    pub name: String,
    /// Bytes; for a structure that ends in a runtime-sized array, the bytes in front of that array.
    pub size: u32,
    /// Name and offset of each member but a runtime-sized array.
    pub members: Vec<(String, u32)>,
}

/// A compiled module.
pub struct Compiled {
    /// SPIR-V without bounds checks.
    pub spirv: Vec<u32>,
    /// SPIR-V with every index restricted to its array.
    pub spirv_checked: Vec<u32>,
    /// As `spirv`, with arrays as texel buffers.
    pub spirv_texels: Vec<u32>,
    pub entry_point: String,
    pub workgroup_size: [u32; 3],
    /// Sorted by slot.
    pub bindings: Vec<Binding>,
    /// Size of the `var<immediate>`, 0 without one.
    pub push_bytes: u32,
    /// Structures reachable from storage and immediate variables, sorted by name.
    pub structs: Vec<StructLayout>,
}

impl Compiled {
    /// The interface in words; two builds of a kernel with the same words can stand for each other.
    pub fn interface(&self) -> String {
        let mut words = format!("{} push {}", self.entry_point, self.push_bytes);
        for binding in &self.bindings {
            // Writing to a String cannot fail.
            let _ = write!(words, "; {} {} {:?}", binding.slot, binding.name, binding.kind);
        }
        for layout in &self.structs {
            let _ = write!(words, "; {} {}", layout.name, layout.size);
            for (member, offset) in &layout.members {
                let _ = write!(words, " {member}@{offset}");
            }
        }
        words
    }
}

/// Reads `stem`.wgsl in `dir` and resolves its directives. `label` stands for `dir` in messages.
pub fn load(dir: &Path, label: &str, stem: &str, flags: &[&str]) -> Result<Source, String> {
    let file = format!("{label}/{stem}.wgsl");
    let mut source = Source { file: file.clone(), text: String::new(), lines: Vec::new(), files: Vec::new() };
    let mut reader = Reader { dir, label, flags, seen: BTreeSet::new(), tested: BTreeSet::new() };
    reader.append(&mut source, &format!("{stem}.wgsl"))?;
    for flag in flags {
        if !reader.tested.contains(*flag) {
            return Err(format!("{file}: no #if asks for the flag {flag} of {label}/permutations.txt"));
        }
    }
    Ok(source)
}

struct Reader<'a> {
    dir: &'a Path,
    label: &'a str,
    flags: &'a [&'a str],
    seen: BTreeSet<String>,
    tested: BTreeSet<String>,
}

/// An open `#if`.
struct Branch {
    line: usize,
    /// Lines around the `#if` are kept.
    outer: bool,
    /// The flag is set.
    set: bool,
    in_else: bool,
}

impl Reader<'_> {
    fn append(&mut self, source: &mut Source, relative: &str) -> Result<(), String> {
        let path = self.dir.join(relative);
        let shown = format!("{}/{relative}", self.label);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{shown}: {e}"))?;
        let index = source.files.len();
        source.files.push(shown.clone());
        let mut branches: Vec<Branch> = Vec::new();
        for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line)) {
            let fail = |message: &str| format!("{shown}:{number}: {message}");
            let keep = branches.last().is_none_or(|b| b.outer && b.set != b.in_else);
            let Some(directive) = line.trim_start().strip_prefix('#') else {
                if keep {
                    source.text.push_str(line);
                    source.text.push('\n');
                    source.lines.push((index, number));
                }
                continue;
            };
            let (word, rest) = directive.split_once(char::is_whitespace).unwrap_or((directive.trim_end(), ""));
            let rest = rest.trim();
            match word {
                "include" => {
                    let name = rest
                        .strip_prefix('"')
                        .and_then(|r| r.strip_suffix('"'))
                        .ok_or_else(|| fail("write #include \"file.wgsl\""))?;
                    let relative = format!("include/{name}");
                    if keep && self.seen.insert(relative.clone()) {
                        self.append(source, &relative).map_err(|e| format!("{e}\n  included at {shown}:{number}"))?;
                    }
                }
                "if" => {
                    if rest.is_empty() || !rest.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                        return Err(fail("write #if FLAG"));
                    }
                    self.tested.insert(rest.to_owned());
                    let set = self.flags.contains(&rest);
                    branches.push(Branch { line: number, outer: keep, set, in_else: false });
                }
                "else" => match branches.last_mut() {
                    Some(branch) if !branch.in_else && rest.is_empty() => branch.in_else = true,
                    _ => return Err(fail("#else without #if, or with words after it")),
                },
                "endif" => {
                    if branches.pop().is_none() {
                        return Err(fail("#endif without #if"));
                    }
                }
                _ => return Err(fail("unknown directive; known are #include, #if, #else, #endif")),
            }
        }
        match branches.last() {
            Some(open) => Err(format!("{shown}:{}: #if without #endif", open.line)),
            None => Ok(()),
        }
    }
}

impl Source {
    /// `file:line:column` of a place in the text.
    fn place(&self, span: naga::Span) -> String {
        if !span.is_defined() {
            return self.file.clone();
        }
        let at = span.location(&self.text);
        // A span may point behind the last line (end of file): the last line stands for it.
        let line = (at.line_number as usize).saturating_sub(1).min(self.lines.len().saturating_sub(1));
        match self.lines.get(line) {
            Some(&(file, number)) => format!("{}:{number}:{}", self.files[file], at.line_position),
            None => self.file.clone(),
        }
    }

    /// The line of text that a span starts on.
    fn excerpt(&self, span: naga::Span) -> String {
        if !span.is_defined() {
            return String::new();
        }
        let line = (span.location(&self.text).line_number as usize).saturating_sub(1);
        self.text.lines().nth(line).map(|text| format!("\n    {}", text.trim())).unwrap_or_default()
    }

    fn parse_error(&self, error: &naga::front::wgsl::ParseError) -> String {
        let mut message = match error.labels().next() {
            Some((span, _)) => format!("{}: {}{}", self.place(span), error.message(), self.excerpt(span)),
            None => format!("{}: {}", self.file, error.message()),
        };
        for (span, label) in error.labels().filter(|(_, label)| !label.is_empty()) {
            let _ = write!(message, "\n  {}: {label}", self.place(span));
        }
        for note in error.notes() {
            let _ = write!(message, "\n  {note}");
        }
        message
    }

    fn validation_error(&self, error: &naga::WithSpan<naga::valid::ValidationError>) -> String {
        let mut spans = error.spans();
        let mut message = match spans.next() {
            Some((span, _)) => format!("{}: {}{}", self.place(*span), error.as_inner(), self.excerpt(*span)),
            None => format!("{}: {}", self.file, error.as_inner()),
        };
        let mut cause = std::error::Error::source(error.as_inner());
        while let Some(inner) = cause {
            let _ = write!(message, "\n  {inner}");
            cause = inner.source();
        }
        for (span, label) in error.spans() {
            let _ = write!(message, "\n  {}: {label}", self.place(*span));
        }
        message
    }
}

/// Device capabilities allowed to kernels: only subgroup operations, which are checked when a kernel is created.
const CAPABILITIES: [spv::Capability; 12] = [
    spv::Capability::Shader,
    spv::Capability::Matrix,
    spv::Capability::ImageQuery,
    // Of images that become texel buffers.
    spv::Capability::Sampled1D,
    spv::Capability::Image1D,
    spv::Capability::GroupNonUniform,
    spv::Capability::GroupNonUniformVote,
    spv::Capability::GroupNonUniformArithmetic,
    spv::Capability::GroupNonUniformBallot,
    spv::Capability::GroupNonUniformShuffle,
    spv::Capability::GroupNonUniformShuffleRelative,
    spv::Capability::GroupNonUniformQuad,
];

/// Reads and checks a module.
fn parse(source: &Source) -> Result<naga::Module, String> {
    let module = naga::front::wgsl::parse_str(&source.text).map_err(|e| source.parse_error(&e))?;
    validate(source, &module)?;
    Ok(module)
}

fn validate(source: &Source, module: &naga::Module) -> Result<ModuleInfo, String> {
    let capabilities = Capabilities::IMMEDIATES
        | Capabilities::SUBGROUP
        | Capabilities::SUBGROUP_BARRIER
        | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    let mut validator = Validator::new(ValidationFlags::all(), capabilities);
    validator.validate(module).map_err(|e| source.validation_error(&e))
}

/// Compiles a module with exactly one compute entry point.
pub fn compile(source: &Source) -> Result<Compiled, String> {
    let module = parse(source)?;
    let [entry] = module.entry_points.as_slice() else {
        return Err(format!(
            "{}: {} entry points; write one @compute function",
            source.file,
            module.entry_points.len()
        ));
    };
    if entry.stage != naga::ShaderStage::Compute {
        return Err(format!("{}: the entry point {} is not @compute", source.file, entry.name));
    }
    let mut compiled = Compiled {
        spirv: Vec::new(),
        spirv_checked: Vec::new(),
        spirv_texels: Vec::new(),
        entry_point: entry.name.clone(),
        workgroup_size: entry.workgroup_size,
        bindings: Vec::new(),
        push_bytes: 0,
        structs: Vec::new(),
    };
    reflect(source, &module, &mut compiled)?;
    let texels = wgsl_texels::rewrite(&source.text, &module);
    compiled.spirv_checked = write(source, module.clone(), BoundsCheckPolicy::Restrict)?;
    compiled.spirv = write(source, module, BoundsCheckPolicy::Unchecked)?;
    for binding in &mut compiled.bindings {
        let found = texels.buffers.iter().find(|(name, _)| *name == binding.name);
        binding.texel_bytes = found.map_or(0, |(_, bytes)| *bytes);
    }
    compiled.spirv_texels = match texels.buffers.is_empty() {
        true => compiled.spirv.clone(),
        false => {
            let source = Source { text: texels.text, ..source.clone() };
            let code = write(&source, parse(&source)?, BoundsCheckPolicy::Unchecked)?;
            wgsl_texels::images_to_buffers(code)
        }
    };
    Ok(compiled)
}

/// The SPIR-V of a module.
fn write(source: &Source, mut module: naga::Module, policy: BoundsCheckPolicy) -> Result<Vec<u32>, String> {
    // A driver reads all functions of a module whenever a pipeline is made, and most of the library's are not called.
    naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
    wgsl_parameters::read_at_start(&mut module);
    let info = validate(source, &module)?;
    let options = spv::Options {
        lang_version: (1, 3),
        flags: spv::WriterFlags::DEBUG,
        capabilities: Some(CAPABILITIES.into_iter().collect()),
        bounds_check_policies: BoundsCheckPolicies {
            index: policy,
            buffer: policy,
            image_load: policy,
            binding_array: policy,
        },
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: false,
        emit_int_div_checks: false,
        fake_missing_bindings: true,
        ..Default::default()
    };
    let pipeline = spv::PipelineOptions {
        shader_stage: naga::ShaderStage::Compute,
        entry_point: module.entry_points[0].name.clone(),
    };
    let code = spv::write_vec(&module, &info, &options, Some(&pipeline));
    let code = code.map_err(|e| format!("{}: {e}", source.file))?;
    wgsl_spirv::without_strides_in_workgroups(&wgsl_spirv::without_zeros(&code))
        .map_err(|e| format!("{}: {e}", source.file))
}

/// Fills in bindings, push constants and structures.
fn reflect(source: &Source, module: &naga::Module, compiled: &mut Compiled) -> Result<(), String> {
    for (handle, variable) in module.global_variables.iter() {
        let name = variable.name.clone().unwrap_or_default();
        let place = source.place(module.global_variables.get_span(handle));
        let inner = &module.types[variable.ty].inner;
        let kind = match (variable.space, inner) {
            (naga::AddressSpace::Private | naga::AddressSpace::WorkGroup, _) => continue,
            (naga::AddressSpace::Immediate, _) => {
                compiled.push_bytes = inner.size(module.to_ctx()).next_multiple_of(4);
                collect_structs(module, variable.ty, &mut compiled.structs);
                continue;
            }
            (naga::AddressSpace::Storage { access }, _) => {
                collect_structs(module, variable.ty, &mut compiled.structs);
                if access.contains(naga::StorageAccess::STORE) { Kind::ReadWrite } else { Kind::Read }
            }
            (_, naga::TypeInner::Image { class: naga::ImageClass::Storage { .. }, .. }) => Kind::Image,
            (_, naga::TypeInner::Image { class: naga::ImageClass::Sampled { .. }, arrayed: true, .. }) => Kind::Layers,
            (_, naga::TypeInner::Image { class: naga::ImageClass::Sampled { .. }, arrayed: false, .. }) => {
                Kind::Sampled
            }
            _ => {
                let taken = "storage buffers, storage textures, textures and arrays of them";
                return Err(format!("{place}: {name}: kernels take {taken} only"));
            }
        };
        match &variable.binding {
            Some(binding) if binding.group == 0 => {
                if let Some(other) = compiled.bindings.iter().find(|other| other.slot == binding.binding) {
                    return Err(format!("{place}: {name}: binding {} is taken by {}", other.slot, other.name));
                }
                let fixed_bytes = fixed_bytes(module, inner);
                compiled.bindings.push(Binding { name, slot: binding.binding, kind, texel_bytes: 0, fixed_bytes });
            }
            _ => return Err(format!("{place}: {name}: write @group(0) @binding(n)")),
        }
    }
    compiled.bindings.sort_by_key(|binding| binding.slot);
    compiled.structs.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(())
}

/// Bytes of a type in front of a runtime-sized array at its end.
fn fixed_bytes(module: &naga::Module, inner: &naga::TypeInner) -> u32 {
    let is_dynamic =
        |inner: &naga::TypeInner| matches!(inner, naga::TypeInner::Array { size: naga::ArraySize::Dynamic, .. });
    match inner {
        naga::TypeInner::Image { .. } => 0,
        inner if is_dynamic(inner) => 0,
        naga::TypeInner::Struct { members, span } => match members.last() {
            Some(last) if is_dynamic(&module.types[last.ty].inner) => last.offset,
            _ => *span,
        },
        inner => inner.size(module.to_ctx()),
    }
}

/// Appends the layouts of `ty` and of every structure inside it.
fn collect_structs(module: &naga::Module, ty: naga::Handle<naga::Type>, found: &mut Vec<StructLayout>) {
    let ty = &module.types[ty];
    match &ty.inner {
        naga::TypeInner::Array { base, .. } => collect_structs(module, *base, found),
        naga::TypeInner::Struct { members, span } => {
            let name = ty.name.clone().unwrap_or_default();
            if found.iter().any(|layout| layout.name == name) {
                return;
            }
            let mut layout = StructLayout { name, size: *span, members: Vec::new() };
            for member in members {
                let inner = &module.types[member.ty].inner;
                if matches!(inner, naga::TypeInner::Array { size: naga::ArraySize::Dynamic, .. }) {
                    layout.size = member.offset;
                } else {
                    layout.members.push((member.name.clone().unwrap_or_default(), member.offset));
                }
            }
            found.push(layout);
            for member in members {
                collect_structs(module, member.ty, found);
            }
        }
        _ => {}
    }
}
