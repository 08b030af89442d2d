//! The shaded points of a pass, from those of its tasks, in the memory that a device reads.
//!
//! A graphics card unpacks points that come packed: their columns become words as each task comes in, so that their memory serves the next one, and the
//! words are copied as they are (`pass::unpack_points`). Where a processor is the device, for which the kernel takes twice as long, points stay as they came in until
//! all are there, and are then written row by row, each row once: tasks of a row take turns in memory that the processor keeps at hand. So are those of a pass of which some came
//! exactly, on a graphics card too.

use std::ops::Range;

use ash::vk;
use glam::Vec4;

use super::packing::{ARRAYS, Columns, Cursor, Packed, WO, ZERO_IF_PLAIN};
use super::{CAUSTICS, Listed, Shape, TaskPoints, strange, words};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::gpu::{Buffer, Context, Memory, Recorder, Staging};
use crate::pass::layout::{DispatchCounts, FrameParameters};
use crate::pass::unpack_more::{self, UnpackMore};
use crate::pass::unpack_points::{self, UnpackPoints};
use crate::pass::{ShadingPoints, camera_rays};
use crate::view::Task;

/// The points of a task as they came in.
struct Part {
    task: Task,
    /// Their number, without second components.
    pixels: usize,
    listed: Listed,
    form: Form,
}

impl Part {
    /// Words of its pixels in further arrays, if not in words for the device.
    fn more(&self) -> &[u32] {
        match &self.form {
            Form::Exact(TaskPoints { more, .. }) | Form::Columns(_, more) => more,
            Form::Words(_) => &[],
        }
    }
}

enum Form {
    /// Their words in further arrays are with them.
    Exact(TaskPoints),
    /// With their words in further arrays.
    Columns(Box<Columns>, Vec<u32>),
    Words(Box<Sent>),
}

/// Packed points among the words of a pass.
struct Sent {
    place: unpack_points::Part,
    more: Vec<unpack_more::Part>,
    parameters: FrameParameters,
    /// As they came, in case others of the pass come exactly.
    bytes: Vec<u8>,
}

/// Where the points of a pass have been written.
enum Written {
    /// Rows of each array, component by component; the others are zeros, or nobody's.
    Rows(Vec<Vec<Range<u32>>>),
    /// Words, which the device unpacks.
    Words,
}

/// The shaded points of a pass, put together of those of its tasks.
pub struct PassPoints {
    shape: Shape,
    parts: Vec<Part>,
    tiles: Vec<u32>,
    missing: usize,
    /// Memory that the device copies from; made when it is first needed.
    buffers: [Vec<Buffer>; 3],
    /// Whether the device unpacks points.
    on_device: bool,
    /// Words of the points where the device unpacks them.
    words: Vec<u32>,
    /// Memory for words, of the host and of the device.
    packed: Option<[Buffer; 2]>,
    written: Option<Written>,
    /// Slots that light reaches, where near light spreads: of points in words as they come in, of all once they are written.
    lit: Vec<u32>,
}

impl PassPoints {
    /// Without any point, of an engine's view. A graphics card unpacks those that come packed, and the host does where the device is a processor.
    pub fn of(engine: &Engine) -> PassPoints {
        let is_card = engine.context().info().device_type != vk::PhysicalDeviceType::CPU;
        PassPoints::new(Shape::of(engine)).unpacked_on_device(is_card)
    }

    /// Without any point. The host unpacks those that come packed.
    pub fn new(shape: Shape) -> PassPoints {
        let missing = shape.pixels();
        PassPoints {
            shape,
            parts: Vec::new(),
            tiles: Vec::new(),
            missing,
            buffers: [Vec::new(), Vec::new(), Vec::new()],
            on_device: false,
            words: Vec::new(),
            packed: None,
            written: None,
            lit: Vec::new(),
        }
    }

    /// Has the device unpack points that come packed, or the host, row by row.
    pub fn unpacked_on_device(self, on_device: bool) -> PassPoints {
        PassPoints { on_device, ..self }
    }

    /// Takes all points away, for another pass.
    pub fn clear(&mut self) {
        self.missing = self.shape.pixels();
        self.parts.clear();
        self.tiles.clear();
        self.words.clear();
        self.lit.clear();
        self.written = None;
    }

    /// Whether all pixels are there.
    pub fn is_complete(&self) -> bool {
        self.missing == 0
    }

    /// Takes the points of a task. Errors: they do not fit it.
    pub fn take(&mut self, mut points: TaskPoints) -> Result<()> {
        points.task.region.check(self.shape.size)?;
        let listed = Listed::new(&self.shape, &points.tiles);
        let [pixels, second] = self.shape.counts(&points.task, &listed);
        let [by_slot, by_pixel] = self.shape.arrays;
        if points.values.len() != (pixels + second) * by_slot
            || points.hits.len() != pixels * by_pixel
            || points.more.len() != pixels * self.shape.words()
        {
            return Err(strange());
        }
        let tiles = std::mem::take(&mut points.tiles);
        self.check(pixels, &tiles)?;
        self.add(points.task, pixels, (&tiles, listed), Form::Exact(points));
        Ok(())
    }

    /// Takes the points of a task from [`TaskPoints::pack`]. Errors: those of [`TaskPoints::unpack`].
    pub fn take_packed(&mut self, task: Task, bytes: &[u8]) -> Result<()> {
        match Columns::unpack(task, &self.shape, bytes)? {
            Packed::Exact(points) => self.take(points),
            Packed::Columns(tiles, columns) => {
                let pixels = columns.second.next;
                self.check(pixels, &tiles)?;
                let listed = Listed::new(&self.shape, &tiles);
                let form = if self.on_device {
                    if self.shape.spreads_near_light() {
                        self.list_lit(&columns, &task, &listed);
                    }
                    let place = words::append(&mut self.words, &columns, &self.shape, &task, &listed);
                    let more = columns.more.arrays().iter();
                    let more = more.map(|array| words::append_more(&mut self.words, array, &place)).collect();
                    Form::Words(Box::new(Sent { place, more, parameters: columns.parameters, bytes: bytes.to_vec() }))
                } else {
                    let more = columns.more.all(&self.shape, pixels);
                    Form::Columns(columns, more)
                };
                self.add(task, pixels, (&tiles, listed), form);
                Ok(())
            }
        }
    }

    /// Errors: a task has more pixels than are missing, or tiles outside of the image.
    fn check(&self, pixels: usize, tiles: &[u32]) -> Result<()> {
        if pixels > self.missing || tiles.iter().any(|&tile| tile >= self.shape.tile_count()) {
            return Err(strange());
        }
        Ok(())
    }

    fn add(&mut self, task: Task, pixels: usize, (tiles, listed): (&[u32], Listed), form: Form) {
        self.parts.push(Part { task, pixels, listed, form });
        self.tiles.extend_from_slice(tiles);
        self.missing -= pixels;
    }

    /// Writes the points for the buffers of a frame, always of the same device, unless that is done. Errors: some points are missing.
    pub(crate) fn prepare(&mut self, context: &Context, frame: &Frame) -> Result<()> {
        if !self.is_complete() {
            let message = format!("{} pixels of the pass are missing", self.missing);
            return Err(Error::Resource { name: String::from("points"), message });
        }
        if self.written.is_some() {
            return Ok(());
        }
        self.tiles.sort_unstable();
        self.tiles.dedup();
        let in_words = self.parts.iter().all(|part| matches!(part.form, Form::Words(_)))
            && size_of_val(&self.words[..]) as u64 <= context.info().max_storage_buffer_range;
        let mut lit = std::mem::take(&mut self.lit);
        self.written = Some(if in_words {
            self.write_words(context)?;
            lit.sort_unstable();
            Written::Words
        } else {
            lit.clear();
            self.words_to_columns()?;
            self.reserve(context, frame)?;
            self.write_more()?;
            Written::Rows(self.write_rows(&mut lit)?)
        });
        self.lit = lit;
        Ok(())
    }

    /// Unpacks points in words once more, for rows.
    fn words_to_columns(&mut self) -> Result<()> {
        for part in &mut self.parts {
            if let Form::Words(sent) = &part.form
                && let Packed::Columns(_, columns) = Columns::unpack(part.task, &self.shape, &sent.bytes)?
            {
                let more = columns.more.all(&self.shape, part.pixels);
                part.form = Form::Columns(columns, more);
            }
        }
        Ok(())
    }

    /// Writes the words into staging memory, which grows where they need more.
    fn write_words(&mut self, context: &Context) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.words);
        let needed = bytes.len() as u64;
        if self.packed.as_ref().is_none_or(|[upload, _]| upload.bytes() < needed) {
            // Passes differ a little.
            let most = (needed + needed / 8).min(context.info().max_storage_buffer_range);
            let buffer = |memory| Buffer::new(context, "packed points", most, memory);
            self.packed = Some([buffer(Memory::Upload)?, buffer(Memory::Device)?]);
        }
        self.packed.as_ref().map_or(Ok(()), |[upload, _]| upload.write(0, bytes))
    }

    /// Makes the staging buffers of rows.
    fn reserve(&mut self, context: &Context, frame: &Frame) -> Result<()> {
        let all = all_buffers(frame);
        for (own, device) in self.buffers.iter_mut().zip(all) {
            if own.len() != device.len() {
                let buffer = |of: &&Buffer| {
                    Buffer::new(context, &format!("{} (staging)", of.name()), of.bytes(), Memory::Upload)
                };
                *own = device.iter().map(buffer).collect::<Result<_>>()?;
            }
        }
        Ok(())
    }

    /// Stages the points for the buffers of a frame. Second components outside of the tiles of all tasks are
    /// left as they are: nothing reads them. Errors: those of [`PassPoints::prepare`].
    pub(crate) fn stage(&mut self, context: &Context, frame: &Frame) -> Result<Taken<'_>> {
        self.prepare(context, frame)?;
        let mut staging = Staging::new();
        let mut packed = None;
        match (&self.written, &self.packed) {
            (Some(Written::Words), Some([upload, device])) => {
                if self.shape.components > 1 {
                    // Second components in tiles that other tasks list.
                    frame.point_buffers()[0].iter().for_each(|buffer| staging.clear(buffer));
                }
                let further = frame.more_buffers();
                // Pixels without caustics are not among the words.
                further[CAUSTICS].iter().flatten().for_each(|(buffer, _)| staging.clear(buffer));
                staging.copy(upload, (device, 0), 0..size_of_val(&self.words[..]) as u64)?;
                let points = UnpackPoints::new(context, &frame.unpacked(device))?;
                let more = further.map(|array| array.map(|to| UnpackMore::new(context, device, to)).transpose());
                let more = more.into_iter().collect::<Result<Vec<_>>>()?;
                packed = Some(Unpack { points, more, parts: &self.parts, width: self.shape.size[0] });
            }
            (Some(Written::Rows(rows)), _) => self.stage_rows(frame, &mut staging, rows)?,
            _ => {}
        }
        if self.shape.spreads_near_light() {
            staging.stage_into(context, &frame.eye.list.entries, 0, &self.lit)?;
            let groups = (self.lit.len() as u32).div_ceil(64);
            let counts = DispatchCounts { live: self.lit.len() as u32, ..DispatchCounts::of_tiles(groups) };
            staging.stage_into(context, &frame.eye.list.work, 0, &[counts])?;
        }
        staging.stage_into(context, &frame.eye.ideal_tiles.entries, 0, &self.tiles)?;
        let counts = DispatchCounts::of_tiles(self.tiles.len() as u32);
        staging.stage_into(context, &frame.eye.ideal_tiles.work, 0, &[counts])?;
        Ok(Taken { staging, packed })
    }

    /// Stages rows of points.
    fn stage_rows(&self, frame: &Frame, staging: &mut Staging, written: &[Vec<Range<u32>>]) -> Result<()> {
        let device = all_buffers(frame);
        let row = 16 * u64::from(self.shape.size[0]);
        for (i, rows) in written.iter().enumerate() {
            let (array, component) = (i % ARRAYS, (i / ARRAYS) as u64);
            let (from, to) = (&self.buffers[0][array], device[0][array]);
            if component == 0 && rows.iter().map(ExactSizeIterator::len).sum::<usize>() < self.shape.size[1] as usize {
                staging.clear(to);
            }
            let first = component * 16 * self.shape.pixels() as u64;
            for rows in rows {
                staging.copy(from, (to, 0), first + row * u64::from(rows.start)..first + row * u64::from(rows.end))?;
            }
        }
        let pixels = self.shape.pixels() as u64;
        let words = self.shape.more.into_iter().filter(|&words| words > 0);
        for ((from, (to, at)), words) in
            self.buffers[2].iter().zip(frame.more_buffers().into_iter().flatten()).zip(words)
        {
            staging.copy(from, (to, at), 0..4 * words as u64 * pixels)?;
        }
        let mut hits = self.buffers[1].iter().zip(&device[1]);
        hits.try_for_each(|(from, to)| staging.copy(from, (to, 0), 0..from.bytes()))
    }

    /// Lists the slots of a task that light reaches.
    fn list_lit(&mut self, columns: &Columns, task: &Task, listed: &Listed) {
        let slots = self.shape.slots(task, listed).into_iter().zip(&columns.flags);
        let is_lit = |(_, flags): &(usize, &u8)| u32::from(**flags) & ShadingPoints::LIT != 0;
        self.lit.extend(slots.filter(is_lit).map(|(slot, _)| slot as u32));
    }

    /// Writes the words of further arrays into the buffers, row by row.
    fn write_more(&self) -> Result<()> {
        let arrays: Vec<usize> = self.shape.more.into_iter().filter(|&words| words > 0).collect();
        let width = self.shape.size[0];
        let mut rows: Vec<Vec<u32>> = arrays.iter().map(|words| vec![0; words * width as usize]).collect();
        let mut done = vec![0; self.parts.len()];
        for y in 0..if arrays.is_empty() { 0 } else { self.shape.size[1] } {
            for (part, done) in self.parts.iter().zip(&mut done) {
                let mut begin = 0;
                for (row, &words) in rows.iter_mut().zip(&arrays) {
                    for (x, i) in self.shape.row(&part.task, y).zip(*done..) {
                        let from = &part.more()[begin + words * i..][..words];
                        row[words * x as usize..][..words].copy_from_slice(from);
                    }
                    begin += words * part.pixels;
                }
                *done += self.shape.row(&part.task, y).len();
            }
            for (buffer, row) in self.buffers[2].iter().zip(&rows) {
                buffer.write(4 * u64::from(y) * row.len() as u64, bytemuck::cast_slice(row))?;
            }
        }
        Ok(())
    }

    /// Writes all points into the buffers; returns the rows that have been. `lit` receives the slots that light reaches.
    fn write_rows(&self, lit: &mut Vec<u32>) -> Result<Vec<Vec<Range<u32>>>> {
        let [width, height] = self.shape.size;
        let listed = Listed::new(&self.shape, &self.tiles);
        let (components, row_bytes) = (self.shape.components as usize, 16 * u64::from(width));
        let mut filled = vec![Vec::new(); ARRAYS * components];
        let mut walkers: Vec<Walker> = self.parts.iter().map(Walker::new).collect();
        let mut rows = Rows {
            values: vec![vec![[0; 4]; width as usize]; ARRAYS * components],
            hits: vec![vec![[0; 2]; width as usize]; self.shape.arrays[1]],
            plain: true,
        };
        for y in 0..height {
            let has_second = listed.is_met_by(y);
            if !rows.plain {
                // Plain points leave these zeros as they are.
                ZERO_IF_PLAIN.into_iter().for_each(|array| rows.values[array].fill([0; 4]));
            }
            if has_second {
                rows.values[ARRAYS..].iter_mut().for_each(|row| row.fill([0; 4]));
            }
            rows.plain = true;
            walkers.iter_mut().for_each(|walker| walker.write(&self.shape, y, &mut rows));
            for (i, row) in rows.values.iter().enumerate() {
                let (array, component) = (i % ARRAYS, i / ARRAYS);
                let is_written = match component {
                    0 => !(rows.plain && ZERO_IF_PLAIN.contains(&array)),
                    _ => has_second,
                };
                if is_written {
                    let at = u64::from(y) * row_bytes + (component * 16 * self.shape.pixels()) as u64;
                    self.buffers[0][array].write(at, bytemuck::cast_slice(row))?;
                    extend(&mut filled[i], y);
                }
            }
            let lit_components = match (self.shape.spreads_near_light(), has_second) {
                (false, _) => 0,
                (true, false) => 1,
                (true, true) => components,
            };
            for component in 0..lit_components {
                let first = (component * self.shape.pixels()) as u32 + y * width;
                let row = &rows.values[component * ARRAYS + WO];
                let is_lit =
                    |value: &[u32; 4]| ShadingPoints::flags(f32::from_bits(value[3])) & ShadingPoints::LIT != 0;
                lit.extend((first..).zip(row).filter(|(_, value)| is_lit(value)).map(|(slot, _)| slot));
            }
            for (buffer, row) in self.buffers[1].iter().zip(&rows.hits) {
                buffer.write(8 * u64::from(y) * u64::from(width), bytemuck::cast_slice(row))?;
            }
        }
        Ok(filled)
    }
}

/// The points of a pass, staged for the buffers of a frame.
pub(crate) struct Taken<'a> {
    staging: Staging,
    packed: Option<Unpack<'a>>,
}

/// Parts in words, and the kernels that unpack them.
struct Unpack<'a> {
    points: UnpackPoints,
    /// By array.
    more: Vec<Option<UnpackMore>>,
    parts: &'a [Part],
    width: u32,
}

impl Taken<'_> {
    /// Whether the device unpacks them.
    #[cfg(all(feature = "conform", not(test)))]
    pub(crate) fn unpacks(&self) -> bool {
        self.packed.is_some()
    }

    /// Records the copies, then the kernels that unpack points.
    pub(crate) fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.staging.record(rec)?;
        if let Some(Unpack { points, more, parts, width }) = &self.packed {
            for part in *parts {
                let Form::Words(sent) = &part.form else { continue };
                points.record(rec, &sent.place, &sent.parameters)?;
                for words in &sent.more {
                    more[words.array].as_ref().map_or(Ok(()), |more| more.record(rec, words, *width))?;
                }
            }
        }
        Ok(())
    }
}

/// The buffers of a frame that hold points.
fn all_buffers(frame: &Frame) -> [Vec<&Buffer>; 3] {
    let [by_slot, by_pixel] = frame.point_buffers();
    [by_slot, by_pixel, frame.more_buffers().into_iter().flatten().map(|(buffer, _)| buffer).collect()]
}

/// Appends a row to the runs of rows before it.
fn extend(runs: &mut Vec<Range<u32>>, row: u32) {
    match runs.last_mut() {
        Some(last) if last.end == row => last.end += 1,
        _ => runs.push(row..row + 1),
    }
}

/// Values of a row of pixels: array by array, those of second components after those of first ones.
struct Rows {
    values: Vec<Vec<[u32; 4]>>,
    hits: Vec<Vec<[u32; 2]>>,
    /// Whether all first components are plain.
    plain: bool,
}

/// Goes through the points of a task, row by row.
struct Walker<'a> {
    part: &'a Part,
    first: Cursor,
    second: Cursor,
}

impl Walker<'_> {
    fn new(part: &Part) -> Walker<'_> {
        let second = match &part.form {
            Form::Columns(columns, _) => columns.second,
            Form::Exact(_) | Form::Words(_) => Cursor::at(part.pixels),
        };
        Walker { part, first: Cursor::default(), second }
    }

    /// Writes the next row.
    fn write(&mut self, shape: &Shape, y: u32, rows: &mut Rows) {
        let (task, listed) = (&self.part.task, &self.part.listed);
        match &self.part.form {
            Form::Exact(points) => {
                let slots = points.values.len() / ARRAYS;
                let write = |rows: &mut [Vec<[u32; 4]>], x: u32, cursor: &mut Cursor| {
                    let values = points.values.iter().skip(cursor.next).step_by(slots);
                    rows.iter_mut().zip(values).for_each(|(row, value)| row[x as usize] = *value);
                    cursor.next += 1;
                };
                for x in shape.row(task, y) {
                    for (array, row) in rows.hits.iter_mut().enumerate() {
                        row[x as usize] = points.hits[array * self.part.pixels + self.first.next];
                    }
                    write(&mut rows.values[..ARRAYS], x, &mut self.first);
                    rows.plain = false;
                    if listed.has([x, y]) {
                        write(&mut rows.values[ARRAYS..], x, &mut self.second);
                    }
                }
            }
            // The device unpacks them, or `words_to_columns` left none.
            Form::Words(_) => {}
            Form::Columns(columns, _) => {
                let ray = camera_rays::row(&columns.parameters, y);
                let write = |rows: &mut [Vec<[u32; 4]>], x: u32, cursor: &mut Cursor| {
                    let set = |array: usize, value: Vec4| rows[array][x as usize] = bytemuck::cast(value.to_array());
                    columns.put_next(cursor, || ray(x), set);
                };
                for x in shape.row(task, y) {
                    for (array, row) in rows.hits.iter_mut().enumerate() {
                        row[x as usize] = columns.hits[array].at(self.first.next);
                    }
                    rows.plain &= columns.is_plain(&self.first);
                    write(&mut rows.values[..ARRAYS], x, &mut self.first);
                    if listed.has([x, y]) {
                        write(&mut rows.values[ARRAYS..], x, &mut self.second);
                    }
                }
            }
        }
    }
}
