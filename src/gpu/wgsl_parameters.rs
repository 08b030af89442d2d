//! Reads the parameters of a kernel once, at its start.
//!
//! lavapipe (Mesa 22.3) reads an element of a storage buffer that all invocations share by one scalar load where all of them run, and
//! by a loop over its lanes within any `if` or loop, and a kernel that returns early for surplus invocations has all of its code
//! within an `if`. So the members of read-only structures and numbers, such as `frame`, are copied into private variables before
//! anything else, which compilers turn into registers. `velocity` took 77 ms in place of 15 without this.
//!
//! The build script compiles this file too (through `#[path]`), so it depends on nothing else in the crate.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use naga::{AddressSpace, Expression, Function, GlobalVariable, Handle, Module, Range, Span, Statement, StorageAccess};
use naga::{ArraySize, Type, TypeInner};

/// Indices of nested members, from a variable inwards.
type Path = Vec<u32>;

/// Where a pointer of a function leads: the expression that names the variable, and the member.
struct Place {
    root: Handle<Expression>,
    variable: Handle<GlobalVariable>,
    path: Path,
    ty: Handle<Type>,
}

/// Members that hold others.
fn is_compound(inner: &TypeInner) -> bool {
    matches!(inner, TypeInner::Struct { .. } | TypeInner::Array { .. })
}

/// Whether a copy of the type has a size.
fn is_sized(module: &Module, ty: Handle<Type>) -> bool {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members.iter().all(|member| is_sized(module, member.ty)),
        TypeInner::Array { base, size, .. } => matches!(size, ArraySize::Constant(_)) && is_sized(module, *base),
        inner => matches!(inner, TypeInner::Scalar(_) | TypeInner::Vector { .. } | TypeInner::Matrix { .. }),
    }
}

/// Whether the variable is a structure or a number that the kernel only reads.
fn is_parameters(module: &Module, variable: Handle<GlobalVariable>) -> bool {
    let GlobalVariable { space, ty, .. } = module.global_variables[variable];
    let array = matches!(module.types[ty].inner, TypeInner::Array { .. });
    space == AddressSpace::Storage { access: StorageAccess::LOAD } && !array && is_sized(module, ty)
}

/// The member `index` of a compound type.
fn member(module: &Module, ty: Handle<Type>, index: u32) -> Option<Handle<Type>> {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members.get(index as usize).map(|member| member.ty),
        TypeInner::Array { base, .. } => Some(*base),
        _ => None,
    }
}

/// Places of parameters that a function points to by constant indices, and the expressions that name variables of which it also takes
/// elements by indices that are known late, or whole structures.
fn places(module: &Module, function: &Function) -> (HashMap<Handle<Expression>, Place>, HashSet<Handle<Expression>>) {
    let mut places: HashMap<Handle<Expression>, Place> = HashMap::new();
    let mut refused = HashSet::new();
    for (handle, expression) in function.expressions.iter() {
        match *expression {
            Expression::GlobalVariable(variable) if is_parameters(module, variable) => {
                let ty = module.global_variables[variable].ty;
                places.insert(handle, Place { root: handle, variable, path: Vec::new(), ty });
            }
            Expression::AccessIndex { base, index } => {
                let inner = places.get(&base).and_then(|place| {
                    let ty = member(module, place.ty, index)?;
                    let path = place.path.iter().copied().chain([index]).collect();
                    Some(Place { root: place.root, variable: place.variable, path, ty })
                });
                places.extend(inner.map(|place| (handle, place)));
            }
            Expression::Access { base: pointer, .. } | Expression::Load { pointer } => {
                if let Some(place) = places.get(&pointer).filter(|place| is_compound(&module.types[place.ty].inner)) {
                    refused.insert(place.root);
                }
            }
            _ => {}
        }
    }
    (places, refused)
}

/// Rewrites all functions of a module. No function may hand a pointer to parameters to another one, which WGSL forbids as well.
pub fn read_at_start(module: &mut Module) {
    let functions: Vec<_> = module.functions.iter().map(|(handle, _)| Some(handle)).chain([None]).collect();
    let mut read: BTreeMap<Handle<GlobalVariable>, BTreeSet<Path>> = BTreeMap::new();
    let mut roots = Vec::new();
    for &at in &functions {
        let function = at.map_or(&module.entry_points[0].function, |at| &module.functions[at]);
        let (places, refused) = places(module, function);
        for place in places.values().filter(|place| !refused.contains(&place.root)) {
            roots.extend(place.path.is_empty().then_some((at, place.root, place.variable)));
            if !is_compound(&module.types[place.ty].inner) {
                read.entry(place.variable).or_default().insert(place.path.clone());
            }
        }
    }
    let copies: HashMap<_, _> = read
        .keys()
        .map(|&variable| {
            let GlobalVariable { name, ty, .. } = module.global_variables[variable].clone();
            let copy = GlobalVariable {
                name: name.map(|name| format!("{name}_at_start")),
                space: AddressSpace::Private,
                binding: None,
                ty,
                init: None,
                memory_decorations: Default::default(),
            };
            (variable, module.global_variables.append(copy, Span::UNDEFINED))
        })
        .collect();
    for (at, root, variable) in roots {
        if let Some(&copy) = copies.get(&variable) {
            let function = match at {
                Some(at) => &mut module.functions[at],
                None => &mut module.entry_points[0].function,
            };
            function.expressions[root] = Expression::GlobalVariable(copy);
        }
    }
    let entry = &mut module.entry_points[0].function;
    let mut append = |expression| entry.expressions.append(expression, Span::UNDEFINED);
    let mut start = naga::Block::new();
    for (variable, paths) in read {
        let (from, to) =
            (append(Expression::GlobalVariable(variable)), append(Expression::GlobalVariable(copies[&variable])));
        for path in paths {
            let (mut pointer, mut value, mut first) = (to, from, None);
            for index in path {
                value = append(Expression::AccessIndex { base: value, index });
                first.get_or_insert(value);
                pointer = append(Expression::AccessIndex { base: pointer, index });
            }
            value = append(Expression::Load { pointer: value });
            start.push(Statement::Emit(Range::new_from_bounds(first.unwrap_or(value), value)), Span::UNDEFINED);
            start.push(Statement::Store { pointer, value }, Span::UNDEFINED);
        }
    }
    entry.body.splice(0..0, start);
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: &str = "
        struct Inner { a: vec4<f32>, b: vec4<f32> }
        struct Frame { size: vec4<u32>, inner: array<Inner, 2>, table: array<vec4<f32>, 4> }
        @group(0) @binding(0) var<storage, read> frame: Frame;
        @group(0) @binding(1) var<storage, read> count: u32;
        @group(0) @binding(2) var<storage, read_write> out: array<vec4<f32>>;
        fn late(i: u32) -> vec4<f32> { return frame.table[i] + frame.inner[1].b; }
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {
            if id.x >= min(count, frame.size.x) { return; }
            out[id.x] = late(id.x & 3u) * f32(frame.size.y);
        }";

    /// Paths of parameters that a function reads from the buffer itself.
    fn read_from_buffers(module: &Module, function: &Function) -> Vec<Path> {
        let (places, _) = places(module, function);
        let mut found: Vec<Path> =
            places.into_values().map(|place| place.path).filter(|path| !path.is_empty()).collect();
        found.sort();
        found
    }

    #[test]
    fn members_are_read_at_the_start_and_elements_where_they_are_needed() {
        let mut module = naga::front::wgsl::parse_str(KERNEL).unwrap();
        read_at_start(&mut module);
        let valid = naga::valid::Validator::new(Default::default(), Default::default()).validate(&module);
        assert!(valid.is_ok(), "{valid:?}");
        let entry = &module.entry_points[0].function;
        let stores = entry.body.iter().take_while(|s| matches!(s, Statement::Emit(_) | Statement::Store { .. }));
        assert_eq!(stores.filter(|s| matches!(s, Statement::Store { .. })).count(), 3);
        // Only the copies at the start are left in the kernel, and the element of a late index in the function.
        assert_eq!(read_from_buffers(&module, entry), [vec![0], vec![1], vec![1, 1], vec![1, 1, 1]]);
        let (_, late) = module.functions.iter().next().unwrap();
        assert_eq!(read_from_buffers(&module, late), [vec![2]]);
    }
}
