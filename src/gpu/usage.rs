//! Memory of the buffers and images of a context: what they take, or would take.

use std::collections::BTreeMap;

use super::memory::Memory;
use crate::error::{Error, Result, lowered_by};

/// Memory of buffers and images, bytes.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// On the device.
    pub device: u64,
    /// Of uploads, until they are done, and of what is read back.
    pub transfer: u64,
    /// Whether transfers take memory of the device as well: on processors and integrated graphics cards.
    pub unified: bool,
    /// Of each name, the largest first.
    pub by_name: Vec<(String, u64)>,
}

impl MemoryUse {
    /// On the device and for transfers.
    pub fn total(&self) -> u64 {
        self.device + self.transfer
    }

    /// Bytes that the device's memory must hold; [`super::ContextOptions::max_memory`] limits them. Without transfers on a graphics card
    /// with memory of its own.
    pub fn of_device(&self) -> u64 {
        if self.unified { self.total() } else { self.device }
    }

    /// The setting that lowers most of it.
    pub(crate) fn advice(&self) -> &'static str {
        let mut sums: BTreeMap<&'static str, u64> = BTreeMap::new();
        self.by_name.iter().for_each(|(name, bytes)| *sums.entry(lowered_by(name)).or_default() += bytes);
        // Without any memory there is nothing to lower.
        sums.into_iter().max_by_key(|(_, bytes)| *bytes).map_or("free some", |(advice, _)| advice)
    }
}

/// The sums, and their limit.
#[derive(Debug)]
pub(super) struct Usage {
    by_name: BTreeMap<String, u64>,
    device: u64,
    transfer: u64,
    /// Bytes that may be taken.
    limit: u64,
    /// Whether transfers take the same memory.
    unified: bool,
}

impl Usage {
    pub fn new(limit: u64, unified: bool) -> Usage {
        Usage { by_name: BTreeMap::new(), device: 0, transfer: 0, limit, unified }
    }

    /// Counts a resource. Errors: [`Error::TooMuchMemory`] if it is too much; then it is not counted.
    pub fn take(&mut self, name: &str, bytes: u64, memory: Memory) -> Result<()> {
        let counts = self.unified || memory == Memory::Device;
        let taken = self.device + if self.unified { self.transfer } else { 0 };
        if counts && taken + bytes > self.limit {
            return Err(Error::TooMuchMemory {
                resource: name.to_owned(),
                needed: taken + bytes,
                limit: self.limit,
                advice: self.use_of_all().advice(),
            });
        }
        *self.sum(memory) += bytes;
        *self.by_name.entry(name.to_owned()).or_default() += bytes;
        Ok(())
    }

    /// Takes a resource off again.
    pub fn give_back(&mut self, name: &str, bytes: u64, memory: Memory) {
        *self.sum(memory) -= bytes;
        if let Some(sum) = self.by_name.get_mut(name) {
            *sum -= bytes;
            if *sum == 0 {
                self.by_name.remove(name);
            }
        }
    }

    fn sum(&mut self, memory: Memory) -> &mut u64 {
        if memory == Memory::Device { &mut self.device } else { &mut self.transfer }
    }

    pub fn use_of_all(&self) -> MemoryUse {
        let mut by_name: Vec<_> = self.by_name.iter().map(|(name, bytes)| (name.clone(), *bytes)).collect();
        by_name.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
        MemoryUse { device: self.device, transfer: self.transfer, unified: self.unified, by_name }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_stays_below_the_limit() {
        for unified in [false, true] {
            let mut usage = Usage::new(100, unified);
            usage.take("a", 60, Memory::Device).unwrap();
            usage.take("b", 30, Memory::Upload).unwrap();
            usage.take("b", 5, Memory::Readback).unwrap();
            let all = usage.use_of_all();
            assert_eq!((all.device, all.transfer, all.total()), (60, 35, 95));
            assert_eq!(all.of_device(), if unified { 95 } else { 60 });
            assert_eq!(all.by_name, [(String::from("a"), 60), (String::from("b"), 35)]);
            // 5 more fit where transfers count, else 40.
            let room = if unified { 5 } else { 40 };
            let error = usage.take("c", room + 1, Memory::Device).unwrap_err();
            assert!(matches!(error, Error::TooMuchMemory { needed: 101, limit: 100, .. }));
            usage.take("photon flux", room, Memory::Device).unwrap();
            usage.give_back("b", 5, Memory::Readback);
            usage.give_back("a", 60, Memory::Device);
            assert_eq!(usage.use_of_all().by_name.iter().map(|(_, bytes)| bytes).sum::<u64>(), 30 + room);
            assert!(usage.use_of_all().advice().contains(if unified { "--resolution" } else { "--photons" }));
        }
    }
}
