//! Columns of a task's points as words, which the device unpacks (`pass::unpack_points`).

use super::packing::{Columns, OFF_RAY, RICH};
use super::{Listed, Shape};
use crate::pass::unpack_points::Part;
use crate::view::Task;

/// Number of a point with more to tell that lies on its ray, among those that do not.
const ON_RAY: u32 = u32::MAX;

/// The largest width and height of an image for [`append`].
pub(super) const MOST: u32 = 1 << 16;

fn three(axes: &[Vec<u8>; 3]) -> impl Iterator<Item = u32> {
    let [r, g, b] = axes.each_ref().map(|axis| axis.iter().copied().map(u32::from));
    r.zip(g).zip(b).map(|((r, g), b)| r | g << 8 | b << 16)
}

/// Appends the words of a task's points, column by column. `listed`: its tiles.
pub(super) fn append(words: &mut Vec<u32>, columns: &Columns, shape: &Shape, task: &Task, listed: &Listed) -> Part {
    let first = words.len() as u32;
    let place = |[x, y]: [u32; 2]| x | y << 16;
    let [top, height] = [task.region.origin[1], task.region.size[1]];
    (top..top + height).for_each(|y| words.extend(shape.row(task, y).map(|x| place([x, y]))));
    if columns.flags.len() > columns.second.next {
        words.extend(shape.pixels_of(task).filter(|&at| listed.has(at)).map(place));
    }
    words.extend(columns.flags.iter().zip(three(&columns.kd)).map(|(&flags, kd)| u32::from(flags) | kd << 8));
    words.extend(columns.normals.codes());
    words.extend(&columns.distances);
    columns.light.iter().for_each(|light| words.extend(light.codes()));

    let pixels = columns.second.next;
    for hits in columns.hits.chunks(pixels.max(1)) {
        [0, 1].into_iter().for_each(|word| words.extend(hits.iter().map(|hit| hit[word])));
    }

    let is_rich = |(_, flags): &(u32, &u8)| u32::from(**flags) & RICH != 0;
    words.extend((0..).zip(&columns.flags).filter(is_rich).map(|(i, _)| i));
    words.extend(columns.high.iter().copied().map(u32::from));
    words.extend(columns.shading.codes());
    words.extend(three(&columns.f0));
    columns.words.iter().for_each(|column| words.extend(column));
    columns.shown.iter().for_each(|shown| words.extend(shown.codes()));
    let mut off_ray = 0..;
    let is_off = |high: &u16| u32::from(*high) & OFF_RAY != 0;
    words.extend(columns.high.iter().map(|high| if is_off(high) { off_ray.next().unwrap_or(ON_RAY) } else { ON_RAY }));

    words.extend(columns.wo.codes());
    words.extend(&columns.depths);
    columns.places.iter().for_each(|axis| words.extend(axis));
    words.extend(columns.throughput.codes());

    let lengths = [columns.flags.len(), pixels, columns.high.len(), columns.depths.len()];
    let [direct, indirect] = &columns.light;
    let [emission, specular] = &columns.shown;
    Part {
        first,
        counts: lengths.map(|length| length as u32),
        exponents: [direct, indirect, emission, specular].map(|colors| colors.shift),
        throughput: columns.throughput.shift,
        step: columns.steps.size(),
        hits: shape.arrays[1] as u32,
    }
}
