use glam::{Affine3A, Quat};

use super::*;
use crate::accel::Ray;
use crate::accel::tests::Random;
use crate::accel::wide::tests::check_nodes;
use crate::scene::builtin;

/// Moves an object and brings the trees up to date.
fn shift(scene: &mut Scene, trees: &mut ObjectTrees, bvh: &mut Bvh, object: u32, transform: Affine3A) -> Changes {
    let used: std::collections::BTreeSet<u32> =
        scene.triangles.iter().filter(|t| t.object == object).flat_map(|t| t.vertices).collect();
    for v in used {
        scene.positions[v as usize] = transform.transform_point3(scene.positions[v as usize]);
    }
    trees.update(bvh, scene, &[object])
}

/// Everything that can be wrong with the trees, rays against all triangles included.
#[track_caller]
fn check(scene: &Scene, trees: &ObjectTrees, bvh: &Bvh) {
    bvh.validate(scene).unwrap();
    let (low, high) = scene.bounds();
    assert_eq!((bvh.min, bvh.max), (low, high));
    let wide = trees.wide.as_ref().unwrap();
    check_nodes(wide, bvh);
    let mut r = Random(4);
    let mut hits = 0;
    for i in 0..300 {
        let origin = low + (high - low) * r.point();
        let t_max = if i % 2 == 0 { f32::INFINITY } else { 0.2 * (high - low).length() };
        let ray = Ray { origin, t_max, direction: r.direction() };
        let nearest = (0..bvh.triangle_count()).filter_map(|k| bvh.intersect(&ray, k)).map(|hit| hit.t);
        let expected = nearest.fold(f32::INFINITY, f32::min);
        assert_eq!(bvh.closest(&ray).map_or(f32::INFINITY, |hit| hit.t), expected, "ray {i}");
        assert_eq!(bvh.occluded(&ray), expected.is_finite(), "ray {i}");
        hits += u32::from(expected.is_finite());
    }
    assert!(hits > 20, "only {hits} rays hit");
}

fn build(scene: &mut Scene) -> (ObjectTrees, Bvh) {
    scene.separate_objects();
    ObjectTrees::build(scene, true).unwrap()
}

#[test]
fn joined_trees_are_valid() {
    for mut scene in [builtin::furnace(0.5, 1.0), builtin::facing_plates(1.0), builtin::room(2000), builtin::room(9000)]
    {
        let (trees, bvh) = build(&mut scene);
        check(&scene, &trees, &bvh);
    }
}

#[test]
fn a_moved_object_is_found_where_it_is() {
    let mut scene = builtin::room(2000);
    let (mut trees, mut bvh) = build(&mut scene);
    let table = scene.objects_named("table 3")[0];
    let spheres = scene.objects_named("spheres 7")[0];
    let mut shapes = std::collections::BTreeSet::new();
    for i in 0..6 {
        let angle = Quat::from_rotation_y(0.4 * i as f32);
        let step = Affine3A::from_rotation_translation(angle, Vec3::new(0.3 * i as f32, 0.001, -0.1 * i as f32));
        for object in [table, spheres] {
            let changes = shift(&mut scene, &mut trees, &mut bvh, object, step);
            let all = 0..bvh.node_min.len();
            shapes.insert(changes.nodes == [all]);
            check(&scene, &trees, &bvh);
        }
    }
    // Both ways of writing nodes have been taken: all of them, and some.
    assert_eq!(shapes.len(), 2, "{shapes:?}");
    // Far out of the room: the padding of all boxes grows.
    let before = trees.padding;
    shift(&mut scene, &mut trees, &mut bvh, table, Affine3A::from_translation(Vec3::X * 100.0));
    assert!(trees.padding > before);
    check(&scene, &trees, &bvh);
}

#[test]
fn the_written_ranges_are_all_that_changed() {
    let mut scene = builtin::room(2000);
    let (mut trees, mut bvh) = build(&mut scene);
    let lamp = scene.objects_named("lamp")[0];
    for step in [Vec3::X * 0.01, Vec3::new(0.0, -1.5, 2.0), Vec3::Z * 9.0] {
        let (old, old_wide) = (bvh.clone(), trees.wide.clone().unwrap());
        let changes = shift(&mut scene, &mut trees, &mut bvh, lamp, Affine3A::from_translation(step));
        let inside = |ranges: &[Range<usize>], i: usize| ranges.iter().any(|range| range.contains(&i));
        let bits = |a: &[f32; 4]| a.map(f32::to_bits);
        for i in 0..bvh.node_min.len() {
            let same =
                bits(&bvh.node_min[i]) == bits(&old.node_min[i]) && bits(&bvh.node_max[i]) == bits(&old.node_max[i]);
            assert!(same || inside(&changes.nodes, i), "node {i}");
        }
        for i in 0..bvh.v0.len() {
            assert!(bvh.v0[i] == old.v0[i] || inside(&changes.triangles, i), "triangle {i}");
        }
        for (i, (new, old)) in trees.wide.as_ref().unwrap().nodes.iter().zip(&old_wide.nodes).enumerate() {
            assert!(bits(new) == bits(old) || inside(&changes.wide, i), "wide vec4 {i}");
        }
    }
}

#[test]
fn moving_back_gives_the_same_trees() {
    let mut scene = builtin::room(2000);
    let (mut trees, mut bvh) = build(&mut scene);
    let (first, first_wide, rest) = (bvh.clone(), trees.wide.clone(), scene.positions.clone());
    let lamp = scene.objects_named("lamp")[0];
    let changes = shift(&mut scene, &mut trees, &mut bvh, lamp, Affine3A::from_translation(Vec3::Y * -2.0));
    let all = 0..bvh.node_min.len();
    assert_eq!(changes.nodes, [all], "another tree over the objects");
    assert_ne!(bvh, first);
    scene.positions = rest;
    trees.update(&mut bvh, &scene, &[lamp]);
    assert_eq!(bvh, first);
    // Nodes over the objects that are no longer in use keep what they had.
    let (wide, first_wide) = (trees.wide.unwrap(), first_wide.unwrap());
    assert_eq!(check_nodes(&wide, &bvh), check_nodes(&first_wide, &first));
    let own = 2 * trees.subtrees.len() * BLOCK;
    let bits = |nodes: &[[f32; 4]]| nodes.iter().map(|a| a.map(f32::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(&wide.nodes[..BLOCK]), bits(&first_wide.nodes[..BLOCK]));
    assert_eq!(bits(&wide.nodes[own..]), bits(&first_wide.nodes[own..]));
    assert_eq!(wide.depth, first_wide.depth);
}

#[test]
fn objects_that_reach_into_each_other_share_a_tree() {
    let mut scene = builtin::room(2000);
    // Every object has parts everywhere.
    let objects = scene.objects.len() as u32;
    (0..).zip(&mut scene.triangles).for_each(|(i, triangle)| triangle.object = i % objects);
    let (mut trees, mut bvh) = build(&mut scene);
    assert_eq!(trees.subtrees.len(), 1);
    check(&scene, &trees, &bvh);
    for object in [3, 5] {
        let changes =
            shift(&mut scene, &mut trees, &mut bvh, object, Affine3A::from_translation(Vec3::new(0.1, 0.2, 0.0)));
        let all = 0..scene.triangles.len();
        assert_eq!(changes.triangles, std::slice::from_ref(&all));
        check(&scene, &trees, &bvh);
    }
    // Objects apart keep their own.
    let (trees, _) = build(&mut builtin::room(2000));
    assert!(trees.subtrees.len() > 20);
}

#[test]
fn a_deformed_tree_is_built_anew() {
    let mut scene = builtin::room(2000);
    let (mut trees, mut bvh) = build(&mut scene);
    let object = scene.objects_named("spheres 0")[0];
    let slot = trees.of_object[object as usize].unwrap();
    let built = trees.subtrees[slot].built_cost;
    // Every triangle goes somewhere else.
    let mut r = Random(8);
    for t in scene.triangles.clone().iter().filter(|t| t.object == object) {
        for v in t.vertices {
            scene.positions[v as usize] = Vec3::new(8.0, 3.0, 6.0) * r.point();
        }
    }
    let changes = trees.update(&mut bvh, &scene, &[object]);
    assert_eq!(changes.reordered, [trees.subtrees[slot].triangles.clone()]);
    assert_ne!(trees.subtrees[slot].built_cost, built);
    check(&scene, &trees, &bvh);
    let fresh = ObjectTrees::build(&scene, true).unwrap();
    assert_eq!(fresh.1, bvh);
}

#[test]
fn padding_covers_the_scale() {
    for scale in [0.0, 1e-30, 0.7, 1.0, 1.5, 2.0, 3e4, 1e30] {
        let p = padding(scale);
        assert!(p >= scale * BOX_PADDING && p <= (2.0 * scale).max(1e-37) * BOX_PADDING, "{scale}: {p}");
    }
    assert!(padding(f32::MAX).is_finite());
}
