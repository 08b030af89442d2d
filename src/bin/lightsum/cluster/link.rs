//! Messages over MPI.

use std::cell::Cell;

use lightsum::cluster::Message;
use lightsum::{Error, Result};
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Equivalence, Root, Source};

use super::LOOK;

/// Tags of messages and of their loads.
const TEXT: i32 = 0;
const LOAD: i32 = 1;
/// Bytes of a load that travel at once: MPI counts in 32 bits.
const PIECE: usize = 1 << 28;

/// A rank's way to the others.
pub struct Link {
    world: SimpleCommunicator,
    sent: Cell<u64>,
}

/// Name of this machine.
pub fn host() -> String {
    mpi::environment::processor_name().unwrap_or_else(|_| String::from("a machine without a name"))
}

impl Link {
    /// Between all ranks of the job.
    pub fn new(universe: &Universe) -> Link {
        Link { world: universe.world(), sent: Cell::new(0) }
    }

    /// The number of this rank.
    pub fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    /// How many ranks there are.
    pub fn ranks(&self) -> usize {
        self.world.size() as usize
    }

    /// Bytes sent.
    pub fn sent(&self) -> u64 {
        self.sent.get()
    }

    /// Sends a message with its load; returns once the memory is free again.
    pub fn send(&self, to: usize, message: &Message, load: &[u8]) {
        let text = message.to_bytes(load.len() as u64);
        let process = self.world.process_at_rank(to as i32);
        process.send_with_tag(&text[..], TEXT);
        load.chunks(PIECE).for_each(|piece| process.send_with_tag(piece, LOAD));
        self.sent.set(self.sent.get() + (text.len() + load.len()) as u64);
    }

    /// The next message with its sender and its load, if there is one. Errors: it is no message of this program.
    pub fn poll(&self) -> Result<Option<(usize, Message, Vec<u8>)>> {
        let any = self.world.any_process();
        let Some((text, status)) = any.immediate_matched_probe_with_tag(TEXT) else { return Ok(None) };
        let mut bytes = vec![0u8; status.count(u8::equivalent_datatype()) as usize];
        text.matched_receive_into(&mut bytes[..]);
        let rank = status.source_rank();
        let strange = |message| Error::Rank { rank: rank as usize, host: String::from("its machine"), message };
        let (message, length) = Message::from_bytes(&bytes).map_err(strange)?;
        let mut load = vec![0u8; length as usize];
        let process = self.world.process_at_rank(rank);
        for piece in load.chunks_mut(PIECE) {
            process.receive_into_with_tag(piece, LOAD);
        }
        Ok(Some((rank as usize, message, load)))
    }

    /// Waits for the next message. It sleeps in between: MPI's own waiting would keep a core busy.
    pub fn wait(&self) -> Result<(usize, Message, Vec<u8>)> {
        loop {
            if let Some(message) = self.poll()? {
                return Ok(message);
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Gives all ranks the bytes of rank 0; all call it, with as many bytes.
    pub fn broadcast(&self, bytes: &mut [u8]) {
        let root = self.world.process_at_rank(0);
        bytes.chunks_mut(PIECE).for_each(|piece| root.broadcast_into(piece));
        if self.rank() == 0 {
            self.sent.set(self.sent.get() + bytes.len() as u64);
        }
    }
}
