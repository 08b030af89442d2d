//! Objects: parts of a scene that move independently.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::Scene;
use crate::settings::keys::nearest;

impl Scene {
    /// Indices of the objects of this name; a file may use one name for several objects.
    pub fn objects_named(&self, name: &str) -> Vec<u32> {
        (0..).zip(&self.objects).filter(|(_, known)| *known == name).map(|(i, _)| i).collect()
    }

    /// The object names most similar to a misspelt one, for a message.
    pub fn objects_like(&self, name: &str) -> String {
        nearest(name, self.objects.iter().map(String::as_str))
    }

    /// Objects with their vertices.
    fn uses(&self) -> Vec<(u32, u32)> {
        let mut uses: Vec<(u32, u32)> = self.triangles.iter().flat_map(|t| t.vertices.map(|v| (t.object, v))).collect();
        uses.sort_unstable();
        uses.dedup();
        uses
    }

    /// The vertices of each object, in the order in which [`Scene::separate_objects`] has them.
    pub fn vertices_of_objects(&self) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.objects.len()];
        self.uses().into_iter().for_each(|(object, vertex)| lists[object as usize].push(vertex));
        lists
    }

    /// Gives each object its own contiguous range of vertices, in the previous order, and drops vertices that no
    /// triangle uses. Returns the range of each object.
    pub fn separate_objects(&mut self) -> Vec<Range<usize>> {
        let uses = self.uses();
        for t in &mut self.triangles {
            // Every use is in the list.
            t.vertices = t.vertices.map(|v| uses.partition_point(|&u| u < (t.object, v)) as u32);
        }
        let take = |old: &[Vec3]| uses.iter().map(|&(_, v)| old[v as usize]).collect();
        self.positions = take(&self.positions);
        self.normals = take(&self.normals);
        self.uvs = uses.iter().map(|&(_, v)| self.uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO)).collect();
        if !self.second_uvs.is_empty() {
            let at = |&(_, v): &(u32, u32)| self.second_uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO);
            self.second_uvs = uses.iter().map(at).collect();
        }
        if !self.lightmap_uvs.is_empty() {
            let at = |&(_, v): &(u32, u32)| self.lightmap_uvs.get(v as usize).copied().unwrap_or(Vec2::NEG_ONE);
            self.lightmap_uvs = uses.iter().map(at).collect();
        }
        if !self.colors.is_empty() {
            self.colors = take(&self.colors);
        }
        let start = |object: u32| uses.partition_point(|u| u.0 < object);
        (0..self.objects.len() as u32).map(|object| start(object)..start(object + 1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Triangle, builtin};
    use super::*;

    #[test]
    fn objects_get_vertices_of_their_own() {
        let mut scene = builtin::facing_plates(1.0);
        // The second object uses two vertices of the first, and one vertex is used by none.
        scene.positions.push(Vec3::splat(9.0));
        scene.normals.push(Vec3::X);
        scene.uvs.push(Vec2::ONE);
        scene.triangles.push(Triangle { vertices: [0, 6, 1], material: 1, object: 1, smooth: false });
        let corners: Vec<_> = (0..scene.triangles.len()).map(|i| scene.triangle_positions(i)).collect();
        assert_eq!(scene.vertices_of_objects(), [vec![0, 1, 2, 3], vec![0, 1, 4, 5, 6, 7]]);
        let ranges = scene.separate_objects();
        assert_eq!(ranges, [0..4, 4..10]);
        assert_eq!((scene.positions.len(), scene.normals.len(), scene.uvs.len()), (10, 10, 10));
        for (i, triangle) in scene.triangles.iter().enumerate() {
            assert_eq!(scene.triangle_positions(i), corners[i]);
            assert!(triangle.vertices.iter().all(|&v| ranges[triangle.object as usize].contains(&(v as usize))));
        }
        let again = scene.clone().separate_objects();
        assert_eq!(again, ranges);
        assert_eq!((scene.objects_named("receiver"), scene.objects_named("lamp").len()), (vec![1], 0));
        assert!(scene.objects_like("recever").starts_with("\"receiver\""));
    }
}
