//! Uploads and downloads.

use std::ops::Range;

use bytemuck::Pod;

use super::context::Context;
use super::memory::{Buffer, Memory};
use super::recorder::Recorder;
use crate::error::Result;

/// Maximum bytes staged at once by [`upload`] and [`download`].
const CHUNK: u64 = 64 << 20;

/// Uploads that are recorded into a caller's command buffer. The staging memory lives until this is dropped and the
/// commands are done (the recorder retains it).
#[derive(Default)]
pub struct Staging {
    copies: Vec<Copy>,
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
        self.copies.iter().map(|copy| copy.bytes).sum()
    }

    /// Records all copies.
    pub fn record(&self, rec: &mut Recorder<'_>) -> Result<()> {
        self.copies.iter().try_for_each(|c| rec.copy_range(&c.from, c.from_at, &c.to, c.to_at, c.bytes))
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
