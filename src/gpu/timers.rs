//! Times of the scopes of a command buffer, measured by the device.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use ash::vk;

use super::context::Context;
use crate::error::{Error, Result};

/// Timestamps around the scopes of one command buffer at a time.
pub struct Timers(pub(super) Arc<TimersInner>);

pub(super) struct TimersInner {
    ctx: Context,
    /// Null if the queue writes no timestamps.
    pool: vk::QueryPool,
    capacity: u32,
    /// Names of the scopes recorded since the last reset; scope i has the queries 2i and 2i + 1.
    names: Mutex<Vec<String>>,
    /// Held while commands that are timed are recorded and executed.
    turn: Mutex<()>,
}

impl Timers {
    /// Timestamps for up to `capacity` scopes; scopes beyond are not timed, with a warning.
    pub fn new(ctx: &Context, capacity: u32) -> Result<Timers> {
        let mut inner = TimersInner {
            ctx: ctx.clone(),
            pool: vk::QueryPool::null(),
            capacity: capacity.min(u32::MAX / 2),
            names: Mutex::default(),
            turn: Mutex::default(),
        };
        if ctx.inner.timestamp_bits > 0 && inner.capacity > 0 {
            let create =
                vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * inner.capacity);
            // SAFETY: a plain creation on a live device.
            inner.pool =
                unsafe { ctx.device().create_query_pool(&create, None) }.map_err(|r| ctx.failed("timers", r))?;
            ctx.name(inner.pool, "timers");
        }
        Ok(Timers(Arc::new(inner)))
    }

    pub(super) fn belongs_to(&self, ctx: &Context) -> bool {
        Arc::ptr_eq(&self.0.ctx.inner, &ctx.inner)
    }

    /// Takes the timers for the commands of one submission. Errors: they time another one.
    pub(super) fn take_turn(&self, what: &str) -> Result<MutexGuard<'_, ()>> {
        match self.0.turn.try_lock() {
            Ok(turn) => Ok(turn),
            // Nothing is kept under the lock.
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(Error::Resource {
                name: what.to_owned(),
                message: String::from("the timers time other commands; give these timers of their own"),
            }),
        }
    }

    /// Seconds for each name of a scope, summed, in order of first use. The command buffer must have been executed.
    /// Empty if the device writes no timestamps.
    pub fn read(&self) -> Result<Vec<(String, f64)>> {
        let inner = &*self.0;
        let names = inner.names.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if inner.pool == vk::QueryPool::null() || names.is_empty() {
            return Ok(Vec::new());
        }
        let mut ticks = vec![0u64; 2 * names.len()];
        // SAFETY: the pool is alive and has at least as many queries (`begin` keeps to the capacity).
        unsafe { inner.ctx.device().get_query_pool_results(inner.pool, 0, &mut ticks, vk::QueryResultFlags::TYPE_64) }
            .map_err(|r| inner.ctx.failed("timestamps of a command buffer that has not been executed", r))?;
        let bits = inner.ctx.inner.timestamp_bits;
        let mask = if bits >= 64 { u64::MAX } else { (1 << bits) - 1 };
        let tick = f64::from(inner.ctx.info().timestamp_period) * 1e-9;
        let mut sums: Vec<(String, f64)> = Vec::new();
        for (name, pair) in names.into_iter().zip(ticks.chunks_exact(2)) {
            // The counter wraps at its valid bits.
            let seconds = (pair[1].wrapping_sub(pair[0]) & mask) as f64 * tick;
            match sums.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += seconds,
                None => sums.push((name, seconds)),
            }
        }
        Ok(sums)
    }
}

impl TimersInner {
    /// Records the reset of all queries.
    ///
    /// # Safety
    /// The command buffer is recording, on this context's device.
    pub unsafe fn reset(&self, commands: vk::CommandBuffer) {
        self.names.lock().unwrap_or_else(PoisonError::into_inner).clear();
        if self.pool != vk::QueryPool::null() {
            // SAFETY: the caller's promise.
            unsafe { self.ctx.device().cmd_reset_query_pool(commands, self.pool, 0, 2 * self.capacity) };
        }
    }

    /// Starts timing a scope; returns what `end` takes.
    ///
    /// # Safety
    /// As `reset`.
    pub unsafe fn begin(&self, commands: vk::CommandBuffer, name: &str) -> Option<u32> {
        if self.pool == vk::QueryPool::null() {
            return None;
        }
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if names.len() >= self.capacity as usize {
            log::warn!("{name}: not timed, more than {} scopes", self.capacity);
            return None;
        }
        let query = 2 * names.len() as u32;
        names.push(name.to_owned());
        // SAFETY: the caller's promise; the query was reset and is written once. The stage is the last one, so that
        // the time starts when all commands before have ended.
        unsafe {
            self.ctx.device().cmd_write_timestamp(commands, vk::PipelineStageFlags::BOTTOM_OF_PIPE, self.pool, query);
        }
        Some(query)
    }

    /// Ends timing a scope.
    ///
    /// # Safety
    /// As `reset`; `query` comes from `begin`.
    pub unsafe fn end(&self, commands: vk::CommandBuffer, query: u32) {
        // SAFETY: as in `begin`.
        unsafe {
            self.ctx.device().cmd_write_timestamp(
                commands,
                vk::PipelineStageFlags::BOTTOM_OF_PIPE,
                self.pool,
                query + 1,
            );
        }
    }
}

impl Drop for TimersInner {
    fn drop(&mut self) {
        // SAFETY: recorders retain the timers until their commands are done. Null is ignored.
        unsafe { self.ctx.device().destroy_query_pool(self.pool, None) };
    }
}
