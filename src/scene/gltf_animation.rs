//! Nodes, skins, morph targets and animations of glTF models.

use glam::{DMat4, Mat4, Quat, Vec3};
use gltf::animation::Interpolation as Kind;
use gltf::animation::Property as Path;
use gltf::{Document, Primitive, Semantic};

use super::animation::{Animation, Channel, Interpolation, Local, Nodes, Property, Skin, Skinned, Target};
use super::gltf::Reader;
use crate::error::Result;

/// The nodes of a document; `roots` are those of its scene.
///
/// Error: a node has two parents or is its own ancestor.
pub(super) fn nodes(document: &Document, roots: &[usize]) -> Result<Nodes, String> {
    let all: Vec<gltf::Node> = document.nodes().collect();
    let mut nodes = Nodes { parents: vec![None; all.len()], ..Nodes::default() };
    let mut visited = vec![false; all.len()];
    let mut visit = |root: usize, nodes: &mut Nodes, strict: bool| {
        // An explicit stack: a chain of nodes may be deeper than the thread's stack.
        let mut stack = vec![(root, None)];
        while let Some((node, parent)) = stack.pop() {
            if std::mem::replace(&mut visited[node], true) {
                if !strict {
                    continue;
                }
                return Err(format!("node {node} has two parents or is its own ancestor"));
            }
            nodes.parents[node] = parent;
            nodes.order.push(node);
            let children: Vec<usize> = all[node].children().map(|child| child.index()).collect();
            stack.extend(children.into_iter().rev().map(|child| (child, Some(node))));
        }
        Ok(())
    };
    roots.iter().try_for_each(|&root| visit(root, &mut nodes, true))?;
    // Joints may lie outside the scene.
    let mut is_root = vec![true; all.len()];
    all.iter().flat_map(|node| node.children()).for_each(|child| is_root[child.index()] = false);
    roots.iter().for_each(|&root| is_root[root] = false);
    (0..all.len()).filter(|&i| is_root[i]).try_for_each(|root| visit(root, &mut nodes, false))?;
    for node in &all {
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        nodes.matrices.push(DMat4::from_cols_array_2d(&own));
        let (translation, rotation, scale) = node.transform().decomposed();
        let rotation = Quat::from_array(rotation);
        nodes.locals.push(Local {
            translation: Vec3::from_array(translation),
            rotation: if rotation.length() > 0.0 { rotation.normalize() } else { Quat::IDENTITY },
            scale: Vec3::from_array(scale),
        });
        let weights = node.weights().or_else(|| node.mesh().and_then(|mesh| mesh.weights()));
        nodes.weights.push(weights.unwrap_or_default().to_vec());
    }
    Ok(nodes)
}

impl Reader<'_> {
    /// The skins of the document.
    pub(super) fn skins(&self) -> Result<Vec<Skin>> {
        let skin = |skin: gltf::Skin| {
            let joints: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
            let inverse_bind: Vec<DMat4> = match skin.inverse_bind_matrices() {
                None => vec![DMat4::IDENTITY; joints.len()],
                Some(accessor) => {
                    let matrices = self.buffers.vectors::<16>(&accessor, "inverseBindMatrices")?;
                    matrices.iter().map(|m| Mat4::from_cols_array(m).as_dmat4()).collect()
                }
            };
            if joints.is_empty() || joints.len() > usize::from(u16::MAX) || inverse_bind.len() < joints.len() {
                let (index, joints, matrices) = (skin.index(), joints.len(), inverse_bind.len());
                let message = format!(
                    "skin {index}: {joints} joints and {matrices} inverse bind matrices; there must be a matrix for each \
                     of 1 to {} joints",
                    u16::MAX
                );
                return Err(self.error(message));
            }
            Ok(Skin { joints, inverse_bind })
        };
        self.document.skins().map(skin).collect()
    }

    /// How the `count` vertices of a primitive follow the joints of a skin; `None` if the primitive does not say.
    pub(super) fn skinned(
        &self,
        primitive: &Primitive,
        count: usize,
        (skin, known): (usize, usize),
        object: &str,
    ) -> Result<Option<Skinned>> {
        let mut sets = Vec::new();
        while let (Some(joints), Some(weights)) =
            (primitive.get(&Semantic::Joints(sets.len() as u32)), primitive.get(&Semantic::Weights(sets.len() as u32)))
        {
            let (joints, weights) = (self.buffers.joints(&joints)?, self.buffers.vectors::<4>(&weights, "WEIGHTS")?);
            if joints.len() != count || weights.len() != count {
                let message = format!("object {object:?}: attributes of one primitive differ in number of elements");
                return Err(self.error(message));
            }
            sets.push((joints, weights));
        }
        if sets.is_empty() {
            return Ok(None);
        }
        let per_vertex = 4 * sets.len();
        let mut skinned = Skinned { skin, per_vertex, joints: Vec::new(), weights: Vec::new() };
        for vertex in 0..count {
            let joints = sets.iter().flat_map(|(joints, _)| joints[vertex]);
            let mut weights: Vec<f32> = sets.iter().flat_map(|(_, weights)| weights[vertex]).collect();
            let sum: f32 = weights.iter().sum();
            if weights.iter().any(|&weight| weight < 0.0) || !sum.is_finite() {
                let message = format!("object {object:?}: weights {weights:?} of vertex {vertex} must not be negative");
                return Err(self.error(message));
            }
            if sum > 0.0 {
                weights.iter_mut().for_each(|weight| *weight /= sum);
            } else {
                // It must follow something.
                weights[0] = 1.0;
            }
            for (joint, &weight) in joints.zip(&weights) {
                let unused = weight == 0.0;
                if !unused && usize::from(joint) >= known {
                    let message = format!(
                        "object {object:?}: joint {joint} of vertex {vertex} is out of range, skin {skin} has {known}"
                    );
                    return Err(self.error(message));
                }
                skinned.joints.push(if unused { 0 } else { joint });
            }
            skinned.weights.append(&mut weights);
        }
        Ok(Some(skinned))
    }

    /// The morph targets of a primitive with `count` vertices.
    pub(super) fn targets(&self, primitive: &Primitive, count: usize, object: &str) -> Result<Vec<Target>> {
        let read = |accessor: Option<gltf::Accessor>, what: &str| -> Result<Vec<Vec3>> {
            let Some(accessor) = accessor else { return Ok(Vec::new()) };
            let deltas = self.buffers.vectors::<3>(&accessor, what)?;
            if deltas.len() != count {
                let message =
                    format!("object {object:?}: a morph target has {} vertices, its primitive {count}", deltas.len());
                return Err(self.error(message));
            }
            Ok(deltas.into_iter().map(Vec3::from_array).collect())
        };
        let target = |target: gltf::mesh::MorphTarget| {
            let positions = read(target.positions(), "POSITION of a morph target")?;
            Ok(Target { positions, normals: read(target.normals(), "NORMAL of a morph target")? })
        };
        primitive.morph_targets().map(target).collect()
    }

    /// The animations of the document that move something.
    pub(super) fn animations(&self) -> Result<Vec<Animation>> {
        let mut list = Vec::new();
        for animation in self.document.animations() {
            let name = animation.name().map_or_else(|| format!("animation {}", animation.index()), str::to_string);
            let mut channels = Vec::new();
            for channel in animation.channels() {
                let error =
                    |what: String| self.error(format!("animation {name:?}, channel {}: {what}", channel.index()));
                channels.extend(self.channel(&channel, &error)?);
            }
            let times = || channels.iter().flat_map(|channel: &Channel| channel.times.iter().map(|&t| f64::from(t)));
            let (start, end) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
            if !channels.is_empty() {
                list.push(Animation { name, start, end, channels });
            }
        }
        Ok(list)
    }

    /// One channel; `None` if its node has nothing that it could change.
    fn channel(
        &self,
        channel: &gltf::animation::Channel,
        error: &dyn Fn(String) -> crate::Error,
    ) -> Result<Option<Channel>> {
        let (node, sampler) = (channel.target().node(), channel.sampler());
        let (property, width) = match channel.target().property() {
            Path::Translation => (Property::Translation, 3),
            Path::Rotation => (Property::Rotation, 4),
            Path::Scale => (Property::Scale, 3),
            Path::MorphTargetWeights => {
                let primitives = node.mesh().into_iter().flat_map(|mesh| mesh.primitives());
                (Property::Weights, primitives.map(|p| p.morph_targets().count()).max().unwrap_or(0))
            }
        };
        if width == 0 {
            return Ok(None);
        }
        let interpolation = match sampler.interpolation() {
            Kind::Linear => Interpolation::Linear,
            Kind::Step => Interpolation::Step,
            Kind::CubicSpline => Interpolation::Cubic,
        };
        let times = self.buffers.scalars(&sampler.input(), "key times")?;
        if let Some(k) = times.windows(2).position(|pair| pair[1] <= pair[0]) {
            let message =
                format!("key times must rise, but key {} is at {} s after {} s", k + 1, times[k + 1], times[k]);
            return Err(error(message));
        }
        let output = sampler.output();
        let mut values: Vec<f32> = match property {
            Property::Rotation => self.buffers.vectors::<4>(&output, "rotations")?.into_iter().flatten().collect(),
            Property::Weights => self.buffers.scalars(&output, "weights")?,
            _ => self.buffers.vectors::<3>(&output, "values of keys")?.into_iter().flatten().collect(),
        };
        let each = Channel::values_of_key(interpolation);
        if times.is_empty() || Some(values.len()) != times.len().checked_mul(each * width) {
            let message = format!(
                "{} keys need {each} times {width} numbers each, there are {} numbers",
                times.len(),
                values.len()
            );
            return Err(error(message));
        }
        if property == Property::Rotation {
            for (k, key) in values.chunks_exact_mut(each * 4).enumerate() {
                let rotation = Quat::from_slice(&key[each / 2 * 4..]);
                let Some(inverse) = Some(rotation.length()).filter(|l| *l > 0.0 && l.is_finite()).map(f32::recip)
                else {
                    return Err(error(format!("the rotation of key {k} is {rotation}, of no length")));
                };
                // The tangents belong to the same curve.
                key.iter_mut().for_each(|x| *x *= inverse);
            }
        }
        Ok(Some(Channel { node: node.index(), property, interpolation, width, times, values }))
    }
}
