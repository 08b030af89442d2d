//! Models that move: nodes, skins and morph targets, and the animations of a file.
//!
//! By glTF 2.0, 3.7.2.2 (morph targets), 3.7.3 (skins), 3.11 and appendix C (interpolation). A pose is computed in double
//! precision from the vertices as the file has them, not from another pose.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use glam::{DMat4, DVec3, Mat3, Quat, Vec3};

use super::{Camera, Light, Scene};

/// The animations of a model, and what they move.
#[derive(Debug)]
pub struct Animations {
    /// The animations, in the file's order; none of them is empty.
    pub list: Vec<Animation>,
    pub(super) nodes: Nodes,
    pub(super) skins: Vec<Skin>,
    /// The parts that some animation moves.
    pub(super) parts: Vec<Part>,
    /// Indices into the scene's lights with their nodes.
    pub(super) lights: Vec<(usize, usize)>,
    /// Indices into the scene's cameras with their nodes.
    pub(super) cameras: Vec<(usize, usize)>,
    /// [`Scene::origin`].
    pub(super) origin: DVec3,
}

/// One animation.
#[derive(Debug)]
pub struct Animation {
    /// Its name; "animation N" if the file has none.
    pub name: String,
    /// Time of the first key, seconds.
    pub start: f64,
    /// Time of the last key, seconds.
    pub end: f64,
    pub(super) channels: Vec<Channel>,
}

/// A property of a node over time.
#[derive(Debug)]
pub(super) struct Channel {
    pub node: usize,
    pub property: Property,
    pub interpolation: Interpolation,
    /// Numbers of a value: 3, for rotations 4, for weights one for each morph target.
    pub width: usize,
    /// Seconds, rising; at least one.
    pub times: Vec<f32>,
    /// One value for each key, or three with cubic splines: tangent before the key, value, tangent after it. Rotations are of unit
    /// length.
    pub values: Vec<f32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Property {
    Translation,
    Rotation,
    Scale,
    Weights,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interpolation {
    Step,
    Linear,
    Cubic,
}

impl Channel {
    /// Number of values for each key.
    pub fn values_of_key(interpolation: Interpolation) -> usize {
        if interpolation == Interpolation::Cubic { 3 } else { 1 }
    }

    /// The value at a time, constant before the first key and after the last.
    pub fn sample(&self, time: f64) -> Vec<f32> {
        let each = Channel::values_of_key(self.interpolation);
        let value = |key: usize, which: usize| &self.values[(key * each + which) * self.width..][..self.width];
        let key = |key: usize| value(key, each / 2).to_vec();
        let after = self.times.partition_point(|&t| f64::from(t) <= time);
        let found = match after {
            0 => key(0),
            _ if after == self.times.len() || self.interpolation == Interpolation::Step => key(after - 1),
            _ => {
                let (a, b) = (after - 1, after);
                let (start, end) = (f64::from(self.times[a]), f64::from(self.times[b]));
                let (length, f) = ((end - start) as f32, ((time - start) / (end - start)) as f32);
                if self.interpolation == Interpolation::Cubic {
                    let (f2, f3) = (f * f, f * f * f);
                    let hermite = |i: usize| {
                        (2.0 * f3 - 3.0 * f2 + 1.0) * value(a, 1)[i]
                            + length * (f3 - 2.0 * f2 + f) * value(a, 2)[i]
                            + (3.0 * f2 - 2.0 * f3) * value(b, 1)[i]
                            + length * (f3 - f2) * value(b, 0)[i]
                    };
                    (0..self.width).map(hermite).collect()
                } else if self.property == Property::Rotation {
                    let [from, to] = [a, b].map(|k| Quat::from_slice(value(k, 0)));
                    from.slerp(to, f).to_array().to_vec()
                } else {
                    (0..self.width).map(|i| value(a, 0)[i] + f * (value(b, 0)[i] - value(a, 0)[i])).collect()
                }
            }
        };
        match self.property {
            Property::Rotation => {
                let q = Quat::from_slice(&found);
                // Splines may pass through zero.
                if q.length() > 0.0 { q.normalize() } else { Quat::IDENTITY }.to_array().to_vec()
            }
            _ => found,
        }
    }
}

/// A node's transform in its parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub translation: Vec3,
    pub rotation: Quat,
    pub scale: Vec3,
}

impl Local {
    fn matrix(&self) -> DMat4 {
        let rotation = self.rotation.as_dquat().normalize();
        DMat4::from_scale_rotation_translation(self.scale.as_dvec3(), rotation, self.translation.as_dvec3())
    }
}

/// The nodes of a model, by index.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    pub parents: Vec<Option<usize>>,
    /// Each after its parent.
    pub order: Vec<usize>,
    /// Transforms relative to the parents.
    pub matrices: Vec<DMat4>,
    pub locals: Vec<Local>,
    /// Weights of the morph targets.
    pub weights: Vec<Vec<f32>>,
}

impl Nodes {
    /// World transforms by the transforms relative to the parents.
    pub fn worlds(&self, matrices: &[DMat4]) -> Vec<DMat4> {
        let mut worlds = matrices.to_vec();
        for &node in &self.order {
            if let Some(parent) = self.parents[node] {
                worlds[node] = worlds[parent] * matrices[node];
            }
        }
        worlds
    }
}

/// The joints of a skin.
#[derive(Debug)]
pub(super) struct Skin {
    /// Their nodes.
    pub joints: Vec<usize>,
    /// From the mesh to each joint at the time of binding.
    pub inverse_bind: Vec<DMat4>,
}

/// The vertices of a primitive, as its file has them.
#[derive(Debug)]
pub(super) struct Part {
    pub node: usize,
    /// Of the mesh within the node.
    pub instance: DMat4,
    /// Its first vertex in the scene.
    pub first: usize,
    pub positions: Vec<Vec3>,
    /// Zero where there are none.
    pub normals: Vec<Vec3>,
    pub targets: Vec<Target>,
    pub skinned: Option<Skinned>,
    /// Whether its winding was turned because it stands mirrored.
    pub mirrored: bool,
}

/// A morph target: what a weight of 1 adds; empty: nothing.
#[derive(Debug)]
pub(super) struct Target {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
}

/// How the vertices of a part follow joints.
#[derive(Debug)]
pub(super) struct Skinned {
    pub skin: usize,
    /// Joints of each vertex.
    pub per_vertex: usize,
    /// Indices into the skin's joints, `per_vertex` of each vertex.
    pub joints: Vec<u16>,
    /// Their weights; those of a vertex add up to 1.
    pub weights: Vec<f32>,
}

impl Part {
    /// Vertices in the scene.
    fn range(&self) -> Range<usize> {
        self.first..self.first + self.positions.len()
    }

    /// Transforms from the mesh to the world: of each joint, or the one of the node.
    pub fn transforms(&self, worlds: &[DMat4], skins: &[Skin]) -> Vec<DMat4> {
        match &self.skinned {
            // The node's own transform does not count.
            Some(Skinned { skin, .. }) => {
                let Skin { joints, inverse_bind } = &skins[*skin];
                joints.iter().zip(inverse_bind).map(|(&joint, &bind)| worlds[joint] * bind).collect()
            }
            None => vec![worlds[self.node] * self.instance],
        }
    }

    /// World positions and unit normals; zero where the mesh has none.
    pub fn place(&self, transforms: &[DMat4], weights: &[f32]) -> (Vec<DVec3>, Vec<Vec3>) {
        let morphed = |base: &[Vec3], deltas: fn(&Target) -> &[Vec3]| -> Vec<Vec3> {
            let mut sums = base.to_vec();
            for (target, &weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                sums.iter_mut().zip(deltas(target)).for_each(|(sum, &delta)| *sum += weight * delta);
            }
            sums
        };
        let bends = self.targets.iter().zip(weights).any(|(_, &weight)| weight != 0.0);
        let (positions, normals) = match bends {
            false => (Cow::Borrowed(&self.positions), Cow::Borrowed(&self.normals)),
            true => {
                let mut normals = morphed(&self.normals, |t| &t.normals);
                normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
                (Cow::Owned(morphed(&self.positions, |t| &t.positions)), Cow::Owned(normals))
            }
        };
        let vertices = positions.iter().zip(normals.iter());
        match &self.skinned {
            Some(Skinned { per_vertex, joints, weights, .. }) => {
                let followed = joints.chunks_exact(*per_vertex).zip(weights.chunks_exact(*per_vertex));
                let placed = vertices.zip(followed).map(|((p, n), (joints, weights))| {
                    let blended = joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
                    let blended = blended.fold(DMat4::ZERO, |sum, (&joint, &weight)| {
                        sum + transforms[usize::from(joint)] * f64::from(weight)
                    });
                    (blended.transform_point3(p.as_dvec3()), self.turned(&cofactors(&blended), *n))
                });
                placed.unzip()
            }
            None if transforms[0] == DMat4::IDENTITY => {
                let normal = |n: &Vec3| if n.is_normalized() { *n } else { n.normalize_or_zero() };
                vertices.map(|(p, n)| (p.as_dvec3(), normal(n))).unzip()
            }
            None => {
                let cofactors = cofactors(&transforms[0]);
                let place = |(p, n): (&Vec3, &Vec3)| {
                    (transforms[0].transform_point3(p.as_dvec3()), self.turned(&cofactors, *n))
                };
                vertices.map(place).unzip()
            }
        }
    }

    fn turned(&self, cofactors: &Mat3, normal: Vec3) -> Vec3 {
        let turned = (*cofactors * normal).normalize_or_zero();
        if self.mirrored { -turned } else { turned }
    }
}

/// The cofactor matrix, which is the inverse transpose up to a factor, and exists for any matrix.
fn cofactors(transform: &DMat4) -> Mat3 {
    let linear = Mat3::from_mat4(transform.as_mat4());
    Mat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    )
}

impl Animations {
    /// Keeps what the animations move; the others stay where they are.
    pub(super) fn keep_moving(&mut self) {
        let count = self.nodes.parents.len();
        let (mut moves, mut bends) = (vec![false; count], vec![false; count]);
        for channel in self.list.iter().flat_map(|animation| &animation.channels) {
            let kind = if channel.property == Property::Weights { &mut bends } else { &mut moves };
            kind[channel.node] = true;
        }
        for &node in &self.nodes.order {
            moves[node] |= self.nodes.parents[node].is_some_and(|parent| moves[parent]);
        }
        let skins = &self.skins;
        self.parts.retain(|part| {
            let carried = match &part.skinned {
                Some(skinned) => skins[skinned.skin].joints.iter().any(|&joint| moves[joint]),
                None => moves[part.node],
            };
            carried || bends[part.node] && !part.targets.is_empty()
        });
        self.lights.retain(|(_, node)| moves[*node]);
        self.cameras.retain(|(_, node)| moves[*node]);
    }

    /// Indices of the animations of this name, or of all for "all" unless one has that name; `None`: the first.
    ///
    /// Error: there is none; the message names those that are.
    pub fn choose(&self, name: Option<&str>) -> Result<Vec<usize>, String> {
        let Some(name) = name else { return Ok(vec![0]) };
        let found: Vec<usize> = (0..self.list.len()).filter(|&i| self.list[i].name == name).collect();
        match (found.first(), name) {
            (Some(&first), _) => Ok(vec![first]),
            (None, "all") => Ok((0..self.list.len()).collect()),
            (None, _) => Err(format!("the model has no animation {name:?}; it has {}", self.names())),
        }
    }

    /// The names of all animations, for a message.
    pub fn names(&self) -> String {
        let names: Vec<String> = self.list.iter().map(|animation| format!("{:?}", animation.name)).collect();
        names.join(", ")
    }

    /// Times of the first and the last key of these animations, seconds.
    pub fn span(&self, chosen: &[usize]) -> (f64, f64) {
        let chosen = chosen.iter().filter_map(|&i| self.list.get(i));
        chosen.fold((f64::INFINITY, f64::NEG_INFINITY), |(start, end), a| (start.min(a.start), end.max(a.end)))
    }

    /// Vertices of the scene that some animation moves.
    pub fn vertices(&self) -> Vec<Range<usize>> {
        self.parts.iter().map(Part::range).collect()
    }

    /// Indices of the scene's lights that some animation moves.
    pub fn lights(&self) -> impl Iterator<Item = usize> {
        self.lights.iter().map(|(light, _)| *light)
    }
}

impl Scene {
    /// Moves vertices, lights and cameras to where the animations of these indices ([`Animations::choose`]) have them at a time in
    /// seconds, whatever the pose before. A property that none of them moves is that of the file. [`Scene::camera`] moves if it
    /// is the file's first.
    ///
    /// The result is not validated: a pose may leave a triangle without area. Nothing happens in a scene without animations.
    pub fn set_pose(&mut self, chosen: &[usize], time: f64) {
        let Some(animations) = self.animations.clone() else { return };
        let Animations { nodes, skins, origin, .. } = Arc::as_ref(&animations);
        let mut locals: Vec<Option<Local>> = vec![None; nodes.parents.len()];
        let mut weights: Vec<Cow<[f32]>> = nodes.weights.iter().map(|w| Cow::Borrowed(w.as_slice())).collect();
        for channel in chosen.iter().filter_map(|&i| animations.list.get(i)).flat_map(|a| &a.channels) {
            let value = channel.sample(time);
            if channel.property == Property::Weights {
                weights[channel.node] = Cow::Owned(value);
                continue;
            }
            let local = locals[channel.node].get_or_insert(nodes.locals[channel.node]);
            match channel.property {
                Property::Rotation => local.rotation = Quat::from_slice(&value),
                Property::Scale => local.scale = Vec3::from_slice(&value),
                _ => local.translation = Vec3::from_slice(&value),
            }
        }
        let matrix = |(local, rest): (&Option<Local>, &DMat4)| local.map_or(*rest, |local| local.matrix());
        let matrices: Vec<DMat4> = locals.iter().zip(&nodes.matrices).map(matrix).collect();
        let worlds = nodes.worlds(&matrices);
        for part in &animations.parts {
            let (positions, normals) = part.place(&part.transforms(&worlds, skins), &weights[part.node]);
            for (own, p) in self.positions[part.range()].iter_mut().zip(positions) {
                *own = (p - *origin).as_vec3();
            }
            for (own, n) in self.normals[part.range()].iter_mut().zip(normals) {
                *own = n.try_normalize().unwrap_or(Vec3::Y);
            }
        }
        for &(light, node) in &animations.lights {
            let at = (worlds[node].w_axis.truncate() - *origin).as_vec3();
            let towards = worlds[node].transform_vector3(DVec3::NEG_Z).as_vec3().normalize_or_zero();
            match &mut self.lights[light] {
                Light::Point { position, .. } => *position = at,
                Light::Spot { position, direction, .. } => (*position, *direction) = (at, towards),
                Light::Directional { direction, .. } => *direction = towards,
                Light::Sphere { .. } | Light::Imported { .. } => {}
            }
        }
        for &(index, node) in &animations.cameras {
            let camera = &mut self.cameras[index].camera;
            let is_the_scenes = index == 0 && self.camera == Some(*camera);
            *camera = placed(camera, &worlds[node], *origin);
            if is_the_scenes {
                self.camera = Some(*camera);
            }
        }
    }
}

/// A camera at a node, which looks along its negative z axis.
fn placed(camera: &Camera, world: &DMat4, origin: DVec3) -> Camera {
    let eye = world.w_axis.truncate() - origin;
    let forward = world.transform_vector3(DVec3::NEG_Z).normalize_or_zero();
    let up = world.transform_vector3(DVec3::Y).as_vec3();
    Camera { eye: eye.as_vec3(), target: (eye + forward).as_vec3(), up, ..*camera }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use super::*;

    fn channel(property: Property, interpolation: Interpolation, width: usize, values: &[f32]) -> Channel {
        let each = Channel::values_of_key(interpolation);
        let times: Vec<f32> = [1.0, 3.0, 4.0][..values.len() / width / each].to_vec();
        Channel { node: 0, property, interpolation, width, times, values: values.to_vec() }
    }

    #[test]
    fn values_between_keys_are_those_by_hand() {
        let values = [0.0, 10.0, 2.0, 20.0, -6.0, 0.0];
        let linear = channel(Property::Weights, Interpolation::Linear, 2, &values);
        let step = channel(Property::Weights, Interpolation::Step, 2, &values);
        for (time, by_line, by_step) in [
            (-5.0, [0.0, 10.0], [0.0, 10.0]),
            (1.0, [0.0, 10.0], [0.0, 10.0]),
            (1.5, [0.5, 12.5], [0.0, 10.0]),
            (3.0, [2.0, 20.0], [2.0, 20.0]),
            (3.75, [-4.0, 5.0], [2.0, 20.0]),
            (4.0, [-6.0, 0.0], [-6.0, 0.0]),
            (99.0, [-6.0, 0.0], [-6.0, 0.0]),
        ] {
            assert_eq!(linear.sample(time), by_line, "{time}");
            assert_eq!(step.sample(time), by_step, "{time}");
        }
    }

    #[test]
    fn a_cubic_spline_has_the_values_and_tangents_of_its_keys() {
        // x^3 - 2x from 1 to 3 and on to 4: a cubic that the spline must follow exactly.
        let (value, slope) = (|x: f32| x * x * x - 2.0 * x, |x: f32| 3.0 * x * x - 2.0);
        let keys: Vec<f32> = [1.0, 3.0, 4.0].iter().flat_map(|&x| [slope(x), value(x), slope(x)]).collect();
        let spline = channel(Property::Weights, Interpolation::Cubic, 1, &keys);
        for x in [1.0f32, 1.25, 2.0, 2.9, 3.0, 3.5, 4.0] {
            let found = spline.sample(f64::from(x))[0];
            assert!((found - value(x)).abs() < 1e-4, "{x}: {found} {}", value(x));
        }
        assert_eq!((spline.sample(0.0)[0], spline.sample(5.0)[0]), (value(1.0), value(4.0)));
        // Tangents on either side of a key may differ.
        let corner = channel(Property::Weights, Interpolation::Cubic, 1, &[0.0, 0.0, 3.0, -1.0, 4.0, 0.0]);
        // 3 at the start and -1 at the end, times the length 2: at the middle 2 + (6 + 2) / 8.
        assert_eq!(corner.sample(2.0)[0], 3.0);
    }

    #[test]
    fn rotations_take_the_shorter_way_at_an_even_pace() {
        let turn = |angle: f32| Quat::from_rotation_z(angle).to_array();
        // The second key is the same rotation by the other quaternion.
        let there: Vec<f32> = turn(0.0).into_iter().chain(turn(FRAC_PI_2).map(|x| -x)).collect();
        let linear = channel(Property::Rotation, Interpolation::Linear, 4, &there);
        for (time, angle) in [(1.0, 0.0), (1.5, 0.25), (2.0, 0.5), (2.6, 0.8)] {
            let found = Quat::from_slice(&linear.sample(time)) * Vec3::X;
            let expected = Quat::from_rotation_z(angle * FRAC_PI_2) * Vec3::X;
            assert!((found - expected).length() < 1e-6, "{time}: {found} {expected}");
        }
        let zero = [0.0; 4];
        let keys: Vec<f32> = [zero, turn(0.0), zero, zero, turn(FRAC_PI_2), zero].concat();
        let cubic = channel(Property::Rotation, Interpolation::Cubic, 4, &keys).sample(2.0);
        let middle = Quat::from_slice(&cubic);
        assert!(middle.is_normalized());
        assert!((middle * Vec3::X - Quat::from_rotation_z(0.5 * FRAC_PI_2) * Vec3::X).length() < 1e-6);
    }
}
