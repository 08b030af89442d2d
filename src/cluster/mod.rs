//! One image on many machines: which passes a film has, what a rank of a cluster renders, and what ranks tell each other. Nothing here
//! knows how messages travel: the command line sends them by MPI (feature `mpi`).

pub mod edits;
pub mod message;
mod passes;
pub mod points;
pub mod schedule;

pub use edits::{Edit, Edits};
pub use message::Message;
pub use passes::Passes;
pub use points::{PassPoints, TaskPoints};
pub use schedule::{Schedule, Task};
