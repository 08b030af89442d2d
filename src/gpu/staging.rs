//! Getting data onto the device and back.

use bytemuck::Pod;

use super::context::Context;
use super::memory::{Buffer, Memory};
use super::recorder::Recorder;
use crate::error::Result;

/// Most that is staged at once by [`upload`] and [`download`].
const CHUNK: u64 = 64 << 20;

/// Uploads that are recorded into a caller's command buffer. The staging memory lives until this is dropped and the
/// commands are done (the recorder retains it).
#[derive(Default)]
pub struct Staging {
    copies: Vec<(Buffer, Buffer, u64)>,
}

impl Staging {
    /// Nothing staged yet.
    pub fn new() -> Staging {
        Staging::default()
    }

    /// Makes a device buffer that will hold `data` once the recorded copies have run.
    pub fn stage<T: Pod>(&mut self, ctx: &Context, name: &str, data: &[T]) -> Result<Buffer> {
        let buffer = Buffer::new(ctx, name, size_of_val(data) as u64, Memory::Device)?;
        self.stage_into(ctx, &buffer, 0, data)?;
        Ok(buffer)
    }

    /// Stages a new content for a part of a buffer; `offset` in bytes.
    pub fn stage_into<T: Pod>(&mut self, ctx: &Context, buffer: &Buffer, offset: u64, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        buffer.check_range(offset, bytes.len() as u64)?;
        if !bytes.is_empty() {
            let staging =
                Buffer::new(ctx, &format!("{} (staging)", buffer.name()), bytes.len() as u64, Memory::Upload)?;
            staging.write(0, bytes)?;
            self.copies.push((staging, buffer.clone(), offset));
        }
        Ok(())
    }

    /// Records all copies.
    pub fn record(&self, rec: &mut Recorder<'_>) -> Result<()> {
        self.copies.iter().try_for_each(|(from, to, offset)| rec.copy_range(from, 0, to, *offset, from.bytes()))
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
    let staging = Buffer::new(ctx, &what, (bytes.len() as u64).min(CHUNK), Memory::Readback)?;
    for (chunk, offset) in bytes.chunks_mut(CHUNK as usize).zip((0u64..).step_by(CHUNK as usize)) {
        ctx.submit_and_wait(&what, None, |rec| rec.copy_range(buffer, offset, &staging, 0, chunk.len() as u64))?;
        staging.read_into(0, chunk)?;
    }
    Ok(values)
}
