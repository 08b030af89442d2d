//! Processes that shade the points of a window's images, which this one filters and shows.

use lightsum::Result;
use lightsum::cluster::{Edits, PassPoints};
use lightsum::engine::Engine;

/// Those of a job.
pub trait Others {
    /// Has the points of a pass shaded unless they are asked for, as the edits have made the engine. `ahead`: those of the pass after it too.
    fn ask(&mut self, engine: &Engine, edits: &Edits, pass: u32, ahead: bool);
    /// Goes on with what was asked for; the points of the pass, once all are there. Errors: nobody is left who shades them.
    fn points(&mut self) -> Result<Option<&mut PassPoints>>;
    /// The pass is recorded.
    fn used(&mut self);
}
