//! Columns of a task's points as words, which the device unpacks ([`unpack_points`], [`unpack_more`]).

use super::more::Array;
use super::packing::{Columns, OFF_RAY, RICH};
use super::{Grid, Listed, Shape};
use crate::pass::{unpack_more, unpack_points};
use crate::view::Task;

/// Number of a point with more to tell that lies on its ray, among those that do not.
const ON_RAY: u32 = u32::MAX;

fn three(axes: &[Vec<u8>; 3]) -> impl Iterator<Item = u32> {
    let [r, g, b] = axes.each_ref().map(|axis| axis.iter().copied().map(u32::from));
    r.zip(g).zip(b).map(|((r, g), b)| r | g << 8 | b << 16)
}

/// Appends the words of a task's points, column by column after the grid of its pixels. `listed`: its tiles.
pub(super) fn append(
    words: &mut Vec<u32>,
    columns: &Columns,
    shape: &Shape,
    task: &Task,
    listed: &Listed,
) -> unpack_points::Part {
    let first = words.len() as u32;
    let Grid { first: corner, step, of_row } = shape.grid(task);
    words.extend(corner.into_iter().chain(step).chain([of_row]));
    words.extend(columns.flags.iter().zip(three(&columns.kd)).map(|(&flags, kd)| u32::from(flags) | kd << 8));
    words.extend(columns.normals.codes());
    words.extend(&columns.distances);
    columns.light.iter().for_each(|light| words.extend(light.codes()));

    let pixels = columns.second.next;
    for hits in &columns.hits {
        words.extend(&hits.triangles);
        words.extend(&hits.distances);
    }
    if columns.flags.len() > pixels {
        let pixel = |[x, y]: [u32; 2]| x + y * shape.size[0];
        words.extend(shape.pixels_of(task).filter(|&at| listed.has(at)).map(pixel));
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
    unpack_points::Part {
        first,
        counts: lengths.map(|length| length as u32),
        exponents: [direct, indirect, emission, specular].map(|colors| colors.shift),
        throughput: columns.throughput.shift,
        step: columns.steps.size(),
        hits: shape.arrays[1] as u32,
    }
}

/// Appends the words of a task in a further array: its pixels that have some, if not all have, and the words. `points`: those of the task, with the grid of its pixels.
pub(super) fn append_more(words: &mut Vec<u32>, array: &Array, points: &unpack_points::Part) -> unpack_more::Part {
    let first = words.len() as u32;
    words.extend(array.which.iter().flatten());
    array.columns.iter().for_each(|column| words.extend(column));
    unpack_more::Part {
        array: array.array,
        grid: points.first,
        first,
        count: array.columns.first().map_or(0, Vec::len) as u32,
        words: array.columns.len() as u32,
        is_listed: array.which.is_some(),
    }
}
