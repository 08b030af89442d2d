//! Named buffers and images; kernels bind those that they declare.

use super::image::Image;
use super::kernel::Bound;
use super::memory::Buffer;

/// A buffer or an image, kept alive.
#[derive(Clone)]
enum Resource {
    Buffer(Buffer),
    Image(Image),
}

impl From<&Buffer> for Resource {
    fn from(buffer: &Buffer) -> Resource {
        Resource::Buffer(buffer.clone())
    }
}

impl From<&Image> for Resource {
    fn from(image: &Image) -> Resource {
        Resource::Image(image.clone())
    }
}

/// A set of buffers and images under their names in shaders. [`super::Kernel::bind_from`] takes the ones that a kernel
/// declares, so a set may hold more than a kernel uses.
#[derive(Clone, Default)]
pub struct Resources(Vec<(&'static str, Resource)>);

impl Resources {
    /// An empty set.
    pub fn new() -> Resources {
        Resources::default()
    }

    /// The set of these buffers.
    pub fn of<const N: usize>(buffers: [(&'static str, &Buffer); N]) -> Resources {
        Resources(buffers.into_iter().map(|(name, buffer)| (name, buffer.into())).collect())
    }

    /// Adds a buffer.
    pub fn with(mut self, name: &'static str, buffer: &Buffer) -> Resources {
        self.0.push((name, buffer.into()));
        self
    }

    /// Adds an image.
    pub fn with_image(mut self, name: &'static str, image: &Image) -> Resources {
        self.0.push((name, image.into()));
        self
    }

    /// Adds all of another set.
    pub fn and(mut self, other: &Resources) -> Resources {
        self.0.extend_from_slice(&other.0);
        self
    }

    /// Bytes of all its buffers and images, each counted once.
    pub fn bytes(&self) -> u64 {
        let distinct = |i: usize| match &self.0[i].1 {
            Resource::Buffer(buffer) => self.0[..i]
                .iter()
                .all(|(_, other)| !matches!(other, Resource::Buffer(other) if other.handle() == buffer.handle())),
            Resource::Image(image) => self.0[..i]
                .iter()
                .all(|(_, other)| !matches!(other, Resource::Image(other) if other.handle() == image.handle())),
        };
        let bytes = |resource: &Resource| match resource {
            Resource::Buffer(buffer) => buffer.bytes(),
            Resource::Image(image) => image.bytes(),
        };
        (0..self.0.len()).filter(|&i| distinct(i)).map(|i| bytes(&self.0[i].1)).sum()
    }

    /// All resources of a name.
    pub(super) fn find<'a>(&'a self, name: &'a str) -> impl Iterator<Item = Bound<'a>> {
        self.0.iter().filter(move |(other, _)| *other == name).map(|(_, resource)| match resource {
            Resource::Buffer(buffer) => Bound::Buffer(buffer),
            Resource::Image(image) => Bound::Image(image),
        })
    }
}
