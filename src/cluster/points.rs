//! Shaded points on their way: a client shades the pixels of a task ([`Renderer::points_of`](crate::Renderer::points_of)), the master puts the tasks
//! of a pass together, filters, and adds the image to the film ([`Renderer::pass_from`](crate::Renderer::pass_from)), as in Wald et al. 2002, 4.2.
//!
//! A point is all that the stages after shading read: position, normals, reflectance, direction to the eye, emission, throughput, and light, 176
//! bytes for each of its components; first hits, 8 or 16 bytes, where edges are antialiased; what spreads the mirror image of a glossy plane, 20 to 68 bytes, where
//! there are such planes; a velocity, 16 bytes, of an open shutter; near light, 32 or 64 bytes, that spreads over pixels of other classes; caustics, 16 or 32 bytes, in scenes with photons. Nothing is rounded, so the image has the bits
//! of a pass by one process; [`packing`] rounds.
//!
//! Cost of a task beside its share of the rays: lights and photons of all classes, and passes over the image that skip its other pixels.

mod columns;
mod more;
pub mod packing;
mod pass;
mod words;

pub use pass::PassPoints;
pub(crate) use pass::Taken;

use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::frame::{Frame, MORE_WORDS};
use crate::gpu::{Buffer, Context, Memory, Recorder};
use crate::pass::layout::DispatchCounts;
use crate::view::{Region, Task};

/// Arrays of [`Frame::more_buffers`] that matter only where the first is not 0; the others matter for all pixels.
const OF_REFLECTORS: std::ops::Range<usize> = 1..4;
/// The first array of [`Frame::more_buffers`] of near light that spreads.
const NEAR: usize = 5;
/// Arrays of [`Frame::more_buffers`] that are 0 at most pixels.
const CAUSTICS: std::ops::Range<usize> = 9..11;

/// The shape of the points of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Width and height.
    pub size: [u32; 2],
    /// Width and height of the interleaving pattern.
    pub pattern: [u32; 2],
    /// Components of a pixel.
    pub components: u32,
    /// Arrays of 16 bytes a slot, and of 8 bytes a pixel.
    pub arrays: [usize; 2],
    /// Words of 32 bits that a pixel has in each further array; 0: there is no such array.
    pub more: [usize; 11],
}

impl Shape {
    /// That of an engine's view.
    pub fn of(engine: &Engine) -> Shape {
        let (plan, [by_slot, by_pixel]) = (engine.plan(), engine.frame().point_buffers());
        let more = engine.frame().more_buffers();
        Shape {
            size: plan.view.size(),
            pattern: plan.settings.pattern,
            components: plan.eye.components,
            arrays: [by_slot.len(), by_pixel.len()],
            more: std::array::from_fn(|i| if more[i].is_some() { MORE_WORDS[i] } else { 0 }),
        }
    }

    /// Whether near light spreads over pixels of other classes.
    fn spreads_near_light(&self) -> bool {
        self.more[NEAR] > 0
    }

    /// Words that a pixel has in further arrays.
    fn words(&self) -> usize {
        self.more.iter().sum()
    }

    fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Columns of the pixels of a task in a row.
    fn row(&self, task: &Task, y: u32) -> impl ExactSizeIterator<Item = u32> + use<> {
        let (Grid { first: [first, top], step: [across, down], .. }, region) = (self.grid(task), task.region);
        let has = y >= top && y - region.origin[1] < region.size[1] && (y - top).is_multiple_of(down);
        (first..if has { region.origin[0] + region.size[0] } else { first }).step_by(across as usize)
    }

    /// Where the pixels of a task lie.
    fn grid(&self, task: &Task) -> Grid {
        let ([across, down], Region { origin, size }) = (self.pattern, task.region);
        let first =
            |axis: usize, class: u32, classes: u32| (class % classes + classes - origin[axis] % classes) % classes;
        let (offset, step) = match task.class {
            None => ([0, 0], [1, 1]),
            Some(class) => ([first(0, class, across), first(1, class / across, down)], [across, down]),
        };
        Grid {
            first: std::array::from_fn(|axis| origin[axis] + offset[axis]),
            step,
            of_row: size[0].saturating_sub(offset[0]).div_ceil(step[0]),
        }
    }

    /// Pixels of a task, row by row.
    fn pixels_of(&self, task: &Task) -> impl Iterator<Item = [u32; 2]> {
        let Region { origin: [_, top], size: [_, height] } = task.region;
        (top..top + height).flat_map(move |y| self.row(task, y).map(move |x| [x, y]))
    }

    fn tile_count(&self) -> u32 {
        self.size[0].div_ceil(8) * self.size[1].div_ceil(8)
    }

    /// Numbers of pixels of a task, and of their second components.
    fn counts(&self, task: &Task, listed: &Listed) -> [usize; 2] {
        let Region { origin: [_, top], size: [_, height] } = task.region;
        let pixels = (top..top + height).map(|y| self.row(task, y).len()).sum();
        let second = if listed.has.is_empty() { 0 } else { self.pixels_of(task).filter(|&at| listed.has(at)).count() };
        [pixels, second]
    }

    /// Slots of a task: its pixels, then their second components in tiles that show mirrors, glass or narrow lobes.
    fn slots(&self, task: &Task, listed: &Listed) -> Vec<usize> {
        let slot = |[x, y]: [u32; 2]| (x + y * self.size[0]) as usize;
        let second = self.pixels_of(task).filter(|&at| listed.has(at)).map(|at| slot(at) + self.pixels());
        self.pixels_of(task).map(slot).chain(second).collect()
    }
}

/// Columns and rows of the pixels of a task, which have equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grid {
    /// Column and row of the first.
    first: [u32; 2],
    /// From one to the next.
    step: [u32; 2],
    /// Pixels of a row.
    of_row: u32,
}

/// Tiles of 8 x 8 pixels that show mirrors, glass or narrow lobes; none where pixels have one component.
struct Listed {
    /// Of a row.
    count: usize,
    has: Vec<bool>,
}

impl Listed {
    /// Of these numbers those that the image has.
    fn new(shape: &Shape, tiles: &[u32]) -> Listed {
        let mut has = vec![false; if shape.components > 1 { shape.tile_count() as usize } else { 0 }];
        tiles.iter().for_each(|&tile| has.get_mut(tile as usize).into_iter().for_each(|has| *has = true));
        Listed { count: shape.size[0].div_ceil(8) as usize, has }
    }

    /// Whether a pixel lies in one.
    fn has(&self, [x, y]: [u32; 2]) -> bool {
        !self.has.is_empty() && self.has[x as usize / 8 + self.count * (y as usize / 8)]
    }

    /// Whether a row of pixels meets one.
    fn is_met_by(&self, y: u32) -> bool {
        !self.has.is_empty() && self.has[self.count * (y as usize / 8)..][..self.count].contains(&true)
    }
}

fn strange() -> Error {
    let message = String::from("the points of a task are cut off or damaged, or those of another one");
    Error::Resource { name: String::from("points"), message }
}

/// The shaded points of a task.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskPoints {
    /// The task.
    pub task: Task,
    /// Tiles in which its pixels show mirrors, glass or narrow lobes, ascending.
    tiles: Vec<u32>,
    /// Values of its slots, array by array.
    pub(crate) values: Vec<[u32; 4]>,
    /// Hits of its pixels, array by array.
    pub(crate) hits: Vec<[u32; 2]>,
    /// Words of its pixels in further arrays, array by array.
    more: Vec<u32>,
}

impl TaskPoints {
    /// Where its values lie in the image.
    #[cfg(all(feature = "conform", not(test)))]
    pub(crate) fn slots(&self, shape: &Shape) -> Vec<usize> {
        shape.slots(&self.task, &Listed::new(shape, &self.tiles))
    }

    /// Pixels of the image with its words in one of the further arrays.
    #[cfg(all(feature = "conform", not(test)))]
    pub(crate) fn further(&self, shape: &Shape, array: usize) -> impl Iterator<Item = (usize, &[u32])> {
        let (slots, [pixels, _]) = (self.slots(shape), shape.counts(&self.task, &Listed::new(shape, &self.tiles)));
        let begin = shape.more[..array].iter().sum::<usize>() * pixels;
        slots.into_iter().take(pixels).zip(self.more[begin..].chunks(shape.more[array].max(1)))
    }

    /// As bytes: numbers of tiles, values, hits and further words as u32, then these, little endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let counts = [self.tiles.len(), self.values.len(), self.hits.len(), self.more.len()].map(|count| count as u32);
        let parts: [&[u8]; 5] = [
            bytemuck::cast_slice(&counts),
            bytemuck::cast_slice(&self.tiles),
            bytemuck::cast_slice(&self.values),
            bytemuck::cast_slice(&self.hits),
            bytemuck::cast_slice(&self.more),
        ];
        parts.concat()
    }

    /// The points of a task from [`TaskPoints::to_bytes`]. Errors: there are more or fewer bytes than they say.
    pub fn from_bytes(task: Task, bytes: &[u8]) -> Result<TaskPoints> {
        let words = |bytes: &[u8]| -> Vec<u32> { bytemuck::pod_collect_to_vec(bytes) };
        let (counts, rest) = bytes.split_at_checked(16).ok_or_else(strange)?;
        let counts = words(counts);
        let [tiles, values, hits, more] =
            [(0, 4), (1, 16), (2, 8), (3, 4)].map(|(i, bytes)| counts[i] as usize * bytes);
        if rest.len() != tiles + values + hits + more {
            return Err(strange());
        }
        let (tiles, rest) = rest.split_at(tiles);
        let (values, rest) = rest.split_at(values);
        let (hits, more) = rest.split_at(hits);
        Ok(TaskPoints {
            task,
            tiles: words(tiles),
            values: bytemuck::pod_collect_to_vec(values),
            hits: bytemuck::pod_collect_to_vec(hits),
            more: words(more),
        })
    }
}

/// Reads the points of a task back: the rows that it lies in.
pub(crate) struct PointReader {
    task: Task,
    shape: Shape,
    rows: Buffer,
    more: Buffer,
    tiles: Buffer,
    work: Buffer,
}

impl PointReader {
    pub(crate) fn new(context: &Context, engine: &Engine, task: &Task) -> Result<PointReader> {
        let shape = Shape::of(engine);
        task.region.check(shape.size)?;
        let pixels = u64::from(shape.size[0]) * u64::from(task.region.size[1]);
        let bytes =
            16 * pixels * u64::from(shape.components) * shape.arrays[0] as u64 + 8 * pixels * shape.arrays[1] as u64;
        let buffer = |name, bytes| Buffer::new(context, name, bytes, Memory::Readback);
        Ok(PointReader {
            task: *task,
            shape,
            rows: buffer("points read back", bytes)?,
            more: buffer("more of the points read back", 4 * (pixels * shape.words() as u64).max(1))?,
            tiles: buffer("tiles read back", 4 * u64::from(shape.tile_count()))?,
            work: buffer("count of tiles read back", size_of::<DispatchCounts>() as u64)?,
        })
    }

    /// Records the copies, after the points of the task.
    pub(crate) fn record(&self, rec: &mut Recorder, frame: &Frame) -> Result<()> {
        let width = u64::from(self.shape.size[0]);
        let (first, pixels) =
            (width * u64::from(self.task.region.origin[1]), width * u64::from(self.task.region.size[1]));
        let [by_slot, by_pixel] = frame.point_buffers();
        let mut at = 0;
        let mut copy = |rec: &mut Recorder, from: &Buffer, first: u64, bytes: u64| -> Result<()> {
            rec.copy_range(from, first * bytes, &self.rows, at, pixels * bytes)?;
            at += pixels * bytes;
            Ok(())
        };
        for buffer in by_slot {
            for component in 0..u64::from(self.shape.components) {
                copy(rec, buffer, first + component * self.shape.pixels() as u64, 16)?;
            }
        }
        by_pixel.into_iter().try_for_each(|buffer| copy(rec, buffer, first, 8))?;
        let mut at = 0;
        for (buffer, words) in frame.more_buffers().into_iter().zip(MORE_WORDS) {
            let Some((buffer, begin)) = buffer else { continue };
            let bytes = 4 * words as u64;
            rec.copy_range(buffer, begin + first * bytes, &self.more, at, pixels * bytes)?;
            at += pixels * bytes;
        }
        if self.shape.components == 1 {
            return Ok(());
        }
        let tiles = &frame.eye.ideal_tiles;
        rec.copy_range(&tiles.entries, 0, &self.tiles, 0, self.tiles.bytes())?;
        rec.copy_range(&tiles.work, 0, &self.work, 0, self.work.bytes())
    }

    /// The points, once the copies have been executed.
    pub(crate) fn read(&self, engine: &Engine) -> Result<TaskPoints> {
        let shape = self.shape;
        let tiles: Vec<u32> = match shape.components {
            1 => Vec::new(),
            _ => {
                let live = self.work.read::<DispatchCounts>()?[0].live;
                self.tiles.read::<u32>()?.into_iter().take(live as usize).collect()
            }
        };
        debug_assert_eq!(shape, Shape::of(engine));
        let listed = Listed::new(&shape, &tiles);
        let (slots, [count, _]) = (shape.slots(&self.task, &listed), shape.counts(&self.task, &listed));
        let rows = self.rows.read::<[u32; 2]>()?;
        let first = (shape.size[0] * self.task.region.origin[1]) as usize;
        let pixels = (shape.size[0] * self.task.region.size[1]) as usize;
        let (of_slots, of_pixels) = rows.split_at(2 * pixels * shape.components as usize * shape.arrays[0]);
        // Within an array rows of second components follow those of first ones.
        let at =
            |slot: usize| if slot < shape.pixels() { slot - first } else { slot - shape.pixels() - first + pixels };
        let places: Vec<usize> = slots.iter().map(|&slot| at(slot)).collect();
        let mut values = Vec::with_capacity(slots.len() * shape.arrays[0]);
        for array in of_slots.chunks_exact(2 * pixels * shape.components as usize) {
            let value = |&place: &usize| {
                let ([a, b], [c, d]) = (array[2 * place], array[2 * place + 1]);
                [a, b, c, d]
            };
            values.extend(places.iter().map(value));
        }
        let of_hits = of_pixels.chunks_exact(pixels);
        let hits = of_hits.flat_map(|array| places[..count].iter().map(|&place| array[place])).collect();
        Ok(TaskPoints { task: self.task, tiles, values, hits, more: self.read_more(&places[..count], pixels)? })
    }

    /// The words of pixels at these places among `pixels` in further arrays.
    fn read_more(&self, places: &[usize], pixels: usize) -> Result<Vec<u32>> {
        let words = self.more.read::<u32>()?;
        let mut more = Vec::with_capacity(places.len() * self.shape.words());
        let (mut begin, mut regions) = (0, Vec::new());
        for (i, count) in self.shape.more.into_iter().enumerate().filter(|(_, count)| *count > 0) {
            let array = &words[begin..begin + count * pixels];
            begin += count * pixels;
            for (k, &place) in places.iter().enumerate() {
                // Of pixels without a reflector nothing wrote what spreads its image.
                let written = !OF_REFLECTORS.contains(&i) || regions.get(k).is_some_and(|&region| region != 0);
                let of_pixel = &array[count * place..count * (place + 1)];
                more.extend(of_pixel.iter().map(|&word| if written { word } else { 0 }));
            }
            if i == 0 {
                regions.clone_from(&more);
            }
        }
        Ok(more)
    }
}
