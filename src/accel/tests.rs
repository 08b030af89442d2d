use super::*;
use crate::sampling::random::{key, random_f32};
use crate::scene::{Material, Triangle, builtin};

/// A scene of single triangles.
fn soup(triangles: &[[Vec3; 3]]) -> Scene {
    let positions: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    Scene {
        normals: vec![Vec3::Z; positions.len()],
        uvs: vec![glam::Vec2::ZERO; positions.len()],
        triangles: (0..triangles.len() as u32)
            .map(|i| Triangle { vertices: [3 * i, 3 * i + 1, 3 * i + 2], material: i % 3, object: 0, smooth: false })
            .collect(),
        positions,
        materials: vec![Material::default(); 3],
        ..Scene::default()
    }
}

pub struct Random(pub u32);

impl Random {
    pub fn next(&mut self) -> f32 {
        self.0 += 1;
        random_f32(key(7, 0, self.0, 0))
    }
    pub fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let d = self.point() * 2.0 - 1.0;
            if d.length_squared() > 0.01 && d.length_squared() < 1.0 {
                return d.normalize();
            }
        }
    }
}

fn random_soup(count: usize, size: f32, scale: f32) -> Scene {
    let mut r = Random(count as u32);
    let triangles: Vec<[Vec3; 3]> = (0..count)
        .map(|_| {
            let c = r.point();
            [0; 3].map(|_| (c + (r.point() - 0.5) * size) * scale)
        })
        .collect();
    soup(&triangles)
}

/// Every triangle in turn, nearest first, ties to the first in the order of the leaves.
fn brute_force(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let mut ray = *ray;
    let mut nearest = None;
    for k in 0..bvh.triangle_count() {
        if let Some(hit) = bvh.intersect(&ray, k) {
            ray.t_max = hit.t;
            nearest = Some(hit);
        }
    }
    nearest
}

#[test]
fn the_tree_is_the_same_on_any_number_of_threads() {
    // Enough triangles for every loop of the builder to be divided among threads.
    let scene = builtin::room(60_000);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Bvh::build(&scene).unwrap())
    };
    let one = build(1);
    for threads in [1, 2, 3, 8] {
        assert!(build(threads) == one, "{threads} threads");
    }
}

#[test]
fn structure_is_valid_at_awkward_counts() {
    for count in [1, 2, 3, 4, 5, 8, 9, 27, 64, 1000, 2049] {
        let scene = random_soup(count, 0.1, 1.0);
        let bvh = Bvh::build(&scene).unwrap();
        bvh.validate(&scene).unwrap();
        assert_eq!(bvh, Bvh::build(&scene).unwrap(), "two builds of {count} triangles differ");
    }
}

#[test]
fn degenerate_arrangements_build() {
    let one = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // Identical triangles, and triangles in one plane: boxes without extent.
    let same = soup(&vec![one; 50_001]);
    let flat: Vec<[Vec3; 3]> = (0..300).map(|i| one.map(|p| p + Vec3::X * (i as f32))).collect();
    for scene in [same, soup(&flat)] {
        let bvh = Bvh::build(&scene).unwrap();
        bvh.validate(&scene).unwrap();
        let hit = bvh.closest(&Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z)).unwrap();
        assert_eq!(hit.t, 1.0);
    }
    assert!(Bvh::build(&Scene::default()).is_err());
}

#[test]
fn validation_finds_faults() {
    let scene = random_soup(100, 0.1, 1.0);
    let good = Bvh::build(&scene).unwrap();
    let faults: [fn(&mut Bvh); 5] = [
        |b| b.node_max[1][0] = -1.0,
        |b| b.node_min[0][3] = f32::from_bits(b.node_count() - 1),
        |b| b.e1[3][3] = b.e1[4][3],
        |b| b.v0[5][0] += 0.25,
        |b| {
            b.v0.pop();
        },
    ];
    for (i, fault) in faults.iter().enumerate() {
        let mut bvh = good.clone();
        fault(&mut bvh);
        assert!(bvh.validate(&scene).is_err(), "fault {i} was not found");
    }
}

#[test]
fn agrees_with_brute_force() {
    for scale in [1e-3, 1.0, 1e4] {
        let scene = random_soup(500, 0.2, scale);
        let bvh = Bvh::build(&scene).unwrap();
        let mut r = Random(99);
        let mut hits = 0;
        for i in 0..3000 {
            let origin = (r.point() * 2.0 - 0.5) * scale;
            let mut direction = r.direction();
            if i % 3 == 0 {
                // Parallel to one or two axes, with zeros of both signs.
                direction[i / 3 % 3] = if i % 2 == 0 { 0.0 } else { -0.0 };
                if i % 9 == 0 {
                    direction[(i / 3 + 1) % 3] = 0.0;
                }
            }
            let t_max = if i % 2 == 0 { f32::INFINITY } else { 0.3 * scale };
            let ray = Ray { origin, t_max, direction };
            let expected = brute_force(&bvh, &ray);
            assert_eq!(bvh.closest(&ray).map(|h| (h.t, h.triangle)), expected.map(|h| (h.t, h.triangle)), "ray {i}");
            assert_eq!(bvh.occluded(&ray), expected.is_some(), "ray {i}");
            hits += u32::from(expected.is_some());
        }
        assert!(hits > 200, "only {hits} rays hit");
    }
}

#[test]
fn rays_in_box_planes_hit() {
    // A unit square in z = 0, seen along the box's own edges: origins in the planes x = 0, y = 0, x = 1, y = 1.
    let s = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
    let scene = soup(&[[s[0], s[1], s[2]], [s[0], s[2], s[3]]]);
    let bvh = Bvh::build(&scene).unwrap();
    for (x, y) in [(0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (1.0, 1.0), (1.0, 0.5), (0.5, 0.5), (0.25, 0.25)] {
        for sign in [1.0, -1.0] {
            let hit = bvh.closest(&Ray::new(Vec3::new(x, y, 2.0 * sign), Vec3::new(0.0, -0.0, -sign)));
            assert_eq!(hit.map(|h| h.t), Some(2.0), "({x}, {y}) from {sign}");
        }
    }
    // In the plane itself: determinant 0.
    assert_eq!(bvh.closest(&Ray::new(Vec3::new(-1.0, 0.5, 0.0), Vec3::X)), None);
    // The ends are not part of a segment.
    assert!(!bvh.occluded(&Ray::between(Vec3::new(0.5, 0.4, 1.0), Vec3::new(0.5, 0.4, 0.0))));
    assert!(bvh.occluded(&Ray::between(Vec3::new(0.5, 0.4, 1.0), Vec3::new(0.5, 0.4, -1e-6))));
}

#[test]
fn shared_edges_and_vertices_do_not_crack() {
    // A closed, bumpy surface seen from inside: rays aimed at its vertices and edges must hit.
    for scale in [1e-3, 1.0, 1e4] {
        let (rings, sectors) = (24u32, 48u32);
        let mut r = Random(5);
        let mut grid = vec![vec![Vec3::ZERO; sectors as usize]; rings as usize + 1];
        for (i, ring) in grid.iter_mut().enumerate() {
            for (j, p) in ring.iter_mut().enumerate() {
                let theta = std::f32::consts::PI * i as f32 / rings as f32;
                let phi = std::f32::consts::TAU * j as f32 / sectors as f32;
                let radius = if i == 0 || i as u32 == rings { 1.0 } else { 0.9 + 0.2 * r.next() };
                *p = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * radius * scale;
            }
        }
        let (north, south) = (Vec3::Z * scale, -Vec3::Z * scale);
        grid[0].fill(north);
        grid[rings as usize].fill(south);
        let mut triangles = Vec::new();
        for i in 0..rings as usize {
            for j in 0..sectors as usize {
                let k = (j + 1) % sectors as usize;
                let (a, b, c, d) = (grid[i][j], grid[i + 1][j], grid[i + 1][k], grid[i][k]);
                if i + 1 < rings as usize {
                    triangles.push([a, b, c]);
                }
                if i > 0 {
                    triangles.push([a, c, d]);
                }
            }
        }
        let scene = soup(&triangles);
        let bvh = Bvh::build(&scene).unwrap();
        let mut slipped = 0;
        for n in 0..20_000 {
            let triangle = &triangles[(r.next() * triangles.len() as f32) as usize];
            let (a, b) = (triangle[n % 3], triangle[(n + 1) % 3]);
            let target = if n % 5 == 0 { a } else { a + (b - a) * r.next() };
            let origin = (r.point() - 0.5) * 0.6 * scale;
            slipped += u32::from(bvh.closest(&Ray::new(origin, target - origin)).is_none());
            slipped += u32::from(bvh.closest(&Ray::new(origin, (target - origin).normalize())).is_none());
        }
        assert!(slipped <= 2, "{slipped} of 40,000 rays slipped through at scale {scale}");
    }
}

#[test]
fn offset_clears_the_surface() {
    for scale in [1e-3, 1.0, 1e4] {
        let scene = random_soup(200, 0.5, scale);
        let bvh = Bvh::build(&scene).unwrap();
        let mut r = Random(3);
        for n in 0..5000 {
            let k = (r.next() * 200.0) as u32;
            let (u, v) = (r.next() * 0.5, r.next() * 0.5);
            let p = bvh.position(&Hit { t: 0.0, u, v, triangle: k });
            let side = if n % 2 == 0 { bvh.normal(k) } else { -bvh.normal(k) };
            let origin = offset_origin(p, side, bvh.scale());
            let moved = (origin - p).length() / scale;
            assert!(moved > 1e-7 && moved < 4e-5, "moved by {moved} of the scene");
            let mut direction = r.direction();
            if direction.dot(side) < 0.0 {
                direction = -direction;
            }
            assert!(
                bvh.intersect(&Ray::new(origin, direction), k).is_none(),
                "ray {n} at scale {scale} meets its start"
            );
        }
    }
}

#[test]
fn normals_of_tiny_and_huge_triangles() {
    for scale in [1e-20, 1e-3, 1.0, 1e15] {
        let n = unit_normal(Vec3::X * scale, Vec3::new(0.5, 2.0, 0.0) * scale);
        assert!((n - Vec3::Z).length() < 1e-6);
    }
}

#[test]
fn steps_stay_far_below_brute_force() {
    let scene = random_soup(20_000, 0.02, 1.0);
    let bvh = Bvh::build(&scene).unwrap();
    bvh.validate(&scene).unwrap();
    let mut r = Random(1);
    let mut steps = Steps::default();
    for _ in 0..1000 {
        bvh.closest_counted(&Ray::new(r.point(), r.direction()), &mut steps);
    }
    assert!(steps.nodes < 1000 * 600, "{} nodes a ray", steps.nodes / 1000);
    assert!(steps.triangles < 1000 * 100, "{} triangles a ray", steps.triangles / 1000);
}
