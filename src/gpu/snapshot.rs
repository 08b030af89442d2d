//! Reading large buffers piece by piece, without a copy of the whole where the host sees the device's memory.

use bytemuck::Pod;

use super::context::Context;
use super::memory::Buffer;
use super::staging::download;
use crate::error::Result;

/// The content of a buffer for the host, which reads it piece by piece, from several threads if it likes.
///
/// A processor's memory and that of many integrated devices is read in place; anything else has been copied to the host.
/// Commands that write the buffer must not run meanwhile.
pub struct Snapshot(Source);

enum Source {
    InPlace(Buffer),
    Copied { of: Buffer, bytes: Vec<u8> },
}

impl Snapshot {
    /// Waits for our own queue's earlier work and reads the buffer back, or gets ready to read it in place.
    pub fn new(ctx: &Context, buffer: &Buffer) -> Result<Snapshot> {
        if !buffer.is_seen_by_host() {
            return Ok(Snapshot(Source::Copied { of: buffer.clone(), bytes: download(ctx, buffer)? }));
        }
        ctx.submit_and_wait(&format!("reading of {}", buffer.name()), None, |_| Ok(()))?;
        Ok(Snapshot(Source::InPlace(buffer.clone())))
    }

    /// Copies the values from number `first` on. Errors: they lie outside the buffer.
    pub fn copy<T: Pod>(&self, first: usize, values: &mut [T]) -> Result<()> {
        let (at, bytes): (_, &mut [u8]) = (first.saturating_mul(size_of::<T>()), bytemuck::cast_slice_mut(values));
        match &self.0 {
            Source::InPlace(buffer) => buffer.read_in_place(at as u64, bytes),
            Source::Copied { of, bytes: copy } => {
                let piece = copy.get(at..at.saturating_add(bytes.len()));
                bytes.copy_from_slice(piece.ok_or_else(|| of.misuse(format!("has no value {first}")))?);
                Ok(())
            }
        }
    }
}
