//! Uploads and downloads.

use std::ops::Range;

use bytemuck::Pod;

use super::context::Context;
use super::image::Image;
use super::memory::{Buffer, Memory};
use super::recorder::{LayerPart, Recorder};
use crate::error::Result;

/// Maximum bytes staged at once by [`upload`] and [`download`].
const CHUNK: u64 = 64 << 20;

/// Uploads that are recorded into a caller's command buffer. The staging memory lives until this is dropped and the
/// commands are done (the recorder retains it).
#[derive(Default)]
pub struct Staging {
    clears: Vec<Buffer>,
    copies: Vec<Copy>,
    images: Vec<Image>,
    parts: Vec<(Buffer, Image, Vec<LayerPart>)>,
}

/// Bytes of a staging buffer and their destination.
struct Copy {
    from: Buffer,
    from_at: u64,
    to: Buffer,
    to_at: u64,
    bytes: u64,
}

/// Ranges with fewer elements than this between them are copied as one; the elements between them are unchanged.
const GAP: usize = 64;

impl Staging {
    /// Without uploads.
    pub fn new() -> Staging {
        Staging::default()
    }

    /// Makes a device buffer that will hold `data` once the recorded copies have run.
    pub fn stage<T: Pod>(&mut self, ctx: &Context, name: &str, data: &[T]) -> Result<Buffer> {
        let buffer = Buffer::new(ctx, name, size_of_val(data) as u64, Memory::Device)?;
        self.stage_into(ctx, &buffer, 0, data)?;
        Ok(buffer)
    }

    /// Stages new content for a part of a buffer; `offset` in bytes.
    pub fn stage_into<T: Pod>(&mut self, ctx: &Context, buffer: &Buffer, offset: u64, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        buffer.check_range(offset, bytes.len() as u64)?;
        if !bytes.is_empty() {
            let bytes_staged = bytes.len() as u64;
            let from = Buffer::new(ctx, &format!("{} (staging)", buffer.name()), bytes_staged, Memory::Upload)?;
            from.write(0, bytes)?;
            self.copies.push(Copy { from, from_at: 0, to: buffer.clone(), to_at: offset, bytes: bytes_staged });
        }
        Ok(())
    }

    /// Has a buffer filled with zeros before all copies.
    pub(crate) fn clear(&mut self, buffer: &Buffer) {
        self.clears.push(buffer.clone());
    }

    /// Has bytes of a buffer of [`Memory::Upload`] copied to the same place in another, counted from a byte there. The host writes them before the copies are recorded, and not
    /// again until these have been executed.
    pub(crate) fn copy(&mut self, from: &Buffer, (to, begin): (&Buffer, u64), range: Range<u64>) -> Result<()> {
        let bytes = range.end.saturating_sub(range.start);
        from.check_range(range.start, bytes)?;
        let to_at = begin + range.start;
        to.check_range(to_at, bytes)?;
        let (from, to) = (from.clone(), to.clone());
        self.copies.push(Copy { from, from_at: range.start, to, to_at, bytes });
        Ok(())
    }

    /// Stages ranges of a buffer's whole content. The buffer already holds the other elements.
    pub fn stage_ranges<T: Pod>(
        &mut self,
        ctx: &Context,
        buffer: &Buffer,
        data: &[T],
        ranges: &[Range<usize>],
    ) -> Result<()> {
        let mut sorted: Vec<Range<usize>> = ranges.iter().filter(|range| !range.is_empty()).cloned().collect();
        sorted.sort_unstable_by_key(|range| range.start);
        let mut merged: Vec<Range<usize>> = Vec::new();
        for range in sorted {
            match merged.last_mut() {
                Some(last) if range.start <= last.end + GAP => last.end = last.end.max(range.end),
                _ => merged.push(range),
            }
        }
        let size = size_of::<T>() as u64;
        let total = merged.iter().map(|range| range.len() as u64 * size).sum();
        if total == 0 {
            return Ok(());
        }
        let from = Buffer::new(ctx, &format!("{} (staging)", buffer.name()), total, Memory::Upload)?;
        let mut from_at = 0;
        for range in merged {
            let (to_at, bytes) = (range.start as u64 * size, range.len() as u64 * size);
            buffer.check_range(to_at, bytes)?;
            from.write(from_at, bytemuck::cast_slice(&data[range]))?;
            self.copies.push(Copy { from: from.clone(), from_at, to: buffer.clone(), to_at, bytes });
            from_at += bytes;
        }
        Ok(())
    }

    /// Bytes staged.
    pub fn bytes(&self) -> u64 {
        let of_images: u64 = self.parts.iter().map(|(from, ..)| from.bytes()).sum();
        self.copies.iter().map(|copy| copy.bytes).sum::<u64>() + of_images
    }

    /// Records all fills and copies.
    pub fn record(&self, rec: &mut Recorder<'_>) -> Result<()> {
        self.images.iter().try_for_each(|image| rec.image_to_general(image))?;
        self.parts.iter().try_for_each(|(from, image, parts)| rec.copy_to_layers(from, image, parts))?;
        self.clears.iter().try_for_each(|buffer| rec.fill(buffer, 0))?;
        self.copies.iter().try_for_each(|c| rec.copy_range(&c.from, c.from_at, &c.to, c.to_at, c.bytes))
    }
}

/// Fills images with layers, through a buffer of at most `CHUNK` bytes at a time. On a device of our own each chunk is copied at once; on a
/// host's the chunks are staged.
pub struct LayerUpload<'a> {
    ctx: &'a Context,
    staging: &'a mut Staging,
    images: Vec<Image>,
    /// Bytes of a chunk.
    capacity: u64,
    /// The buffer, the bytes of it in use, and what they are for: index of the image, part.
    chunk: Option<Buffer>,
    used: u64,
    parts: Vec<(usize, LayerPart)>,
}

impl<'a> LayerUpload<'a> {
    /// For these images, whose content so far is lost; `bytes` will be filled altogether.
    pub fn new(ctx: &'a Context, staging: &'a mut Staging, images: &[Image], bytes: u64) -> Result<LayerUpload<'a>> {
        if ctx.is_adopted() {
            staging.images.extend_from_slice(images);
        } else {
            let name = "the layout of images";
            ctx.submit_and_wait(name, None, |rec| images.iter().try_for_each(|image| rec.image_to_general(image)))?;
        }
        let (images, capacity) = (images.to_vec(), bytes.min(CHUNK));
        Ok(LayerUpload { ctx, staging, images, capacity, chunk: None, used: 0, parts: Vec::new() })
    }

    /// Fills a rectangle of `size` at `origin` in a layer of image number `image` with texels, row by row.
    pub fn fill(
        &mut self,
        image: usize,
        layer: u32,
        origin: [u32; 2],
        size: [u32; 2],
        texels: &[[u8; 4]],
    ) -> Result<()> {
        let width = size[0].max(1) as usize;
        let (mut rest, mut y) = (texels, 0);
        while !rest.is_empty() {
            let free = (self.capacity.saturating_sub(self.used) / 4) as usize / width;
            if free == 0 && self.used > 0 {
                self.flush()?;
                continue;
            }
            // A row that is longer than a chunk has a chunk to itself; no image is that wide.
            let (now, later) = rest.split_at(rest.len().min(width * free.max(1)));
            let rows = (now.len() / width) as u32;
            let bytes: &[u8] = bytemuck::cast_slice(now);
            let chunk = match self.chunk.take() {
                Some(chunk) => chunk,
                None => {
                    let name = format!("{} (staging)", self.images[image].name());
                    Buffer::new(self.ctx, &name, self.capacity.max(bytes.len() as u64), Memory::Upload)?
                }
            };
            chunk.write(self.used, bytes)?;
            self.chunk = Some(chunk);
            let origin = [origin[0], origin[1] + y];
            self.parts.push((image, LayerPart { offset: self.used, layer, origin, size: [size[0], rows] }));
            self.used += bytes.len() as u64;
            (rest, y) = (later, y + rows);
        }
        Ok(())
    }

    /// Copies or stages what is left.
    pub fn finish(mut self) -> Result<()> {
        self.flush()
    }

    fn flush(&mut self) -> Result<()> {
        let parts = std::mem::take(&mut self.parts);
        self.used = 0;
        let Some(chunk) = &self.chunk else { return Ok(()) };
        let of_image =
            |i: usize| parts.iter().filter(|(image, _)| *image == i).map(|(_, part)| *part).collect::<Vec<_>>();
        let copies: Vec<_> = self.images.iter().enumerate().map(|(i, image)| (image, of_image(i))).collect();
        if self.ctx.is_adopted() {
            let copies = copies.into_iter().filter(|(_, parts)| !parts.is_empty());
            self.staging.parts.extend(copies.map(|(image, parts)| (chunk.clone(), image.clone(), parts)));
            self.chunk = None;
            return Ok(());
        }
        let what = format!("upload of {}", chunk.name());
        self.ctx.submit_and_wait(&what, None, |rec| {
            copies.iter().try_for_each(|(image, parts)| rec.copy_to_layers(chunk, image, parts))
        })
    }
}

/// Makes a device buffer that holds `data`, through our own queue.
pub fn upload<T: Pod>(ctx: &Context, name: &str, data: &[T]) -> Result<Buffer> {
    let bytes: &[u8] = bytemuck::cast_slice(data);
    let buffer = Buffer::new(ctx, name, bytes.len() as u64, Memory::Device)?;
    if bytes.is_empty() {
        return Ok(buffer);
    }
    let what = format!("upload of {name}");
    let staging = Buffer::new(ctx, &what, (bytes.len() as u64).min(CHUNK), Memory::Upload)?;
    for (chunk, offset) in bytes.chunks(CHUNK as usize).zip((0u64..).step_by(CHUNK as usize)) {
        staging.write(0, chunk)?;
        ctx.submit_and_wait(&what, None, |rec| rec.copy_range(&staging, 0, &buffer, offset, chunk.len() as u64))?;
    }
    Ok(buffer)
}

/// Reads a buffer back, through our own queue.
pub fn download<T: Pod>(ctx: &Context, buffer: &Buffer) -> Result<Vec<T>> {
    let mut values = vec![T::zeroed(); buffer.count_of::<T>()?];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
    if bytes.is_empty() {
        return Ok(values);
    }
    let what = format!("download of {}", buffer.name());
    if buffer.is_seen_by_host() {
        ctx.submit_and_wait(&what, None, |_| Ok(()))?;
        buffer.read_in_place(0, bytes)?;
        return Ok(values);
    }
    let staging = Buffer::new(ctx, &what, (bytes.len() as u64).min(CHUNK), Memory::Readback)?;
    for (chunk, offset) in bytes.chunks_mut(CHUNK as usize).zip((0u64..).step_by(CHUNK as usize)) {
        ctx.submit_and_wait(&what, None, |rec| rec.copy_range(buffer, offset, &staging, 0, chunk.len() as u64))?;
        staging.read_into(0, chunk)?;
    }
    Ok(values)
}
