//! Passes whose points others shade. From the moment they are asked for a pass until it is recorded the view stays as it is, and what happens
//! meanwhile waits.

use lightsum::Result;

use super::App;

impl App<'_> {
    /// Asks others for the points of the next pass, if it is wanted. Until it is recorded they have tasks.
    pub(super) fn ask(&mut self) -> Result<()> {
        let has_place = self.image[2] > 0 && self.image[3] > 0;
        if self.others.is_none() || self.asked || self.loading.is_some() || !has_place || !self.wants_pass() {
            return Ok(());
        }
        self.fly()?;
        if let Some(error) = self.fit() {
            return Err(error);
        }
        let Some(session) = &self.session else { return Ok(()) };
        let alone = session.stands_alone(&self.look);
        if self.alone != alone {
            self.alone.clone_from(&alone);
            alone.iter().for_each(|why| self.tell(false, format!("rank 0 renders alone: {why}")));
        }
        self.asked = alone.is_none();
        Ok(())
    }

    /// Goes on with the points of the next pass, and tells whether all are there.
    pub(super) fn are_shaded(&mut self) -> bool {
        let (true, Some(session), Some(others)) = (self.asked, &self.session, &mut self.others) else { return false };
        let engine = session.engine();
        // While the view moves nobody knows the next one.
        let ahead = engine.passes_unchanged() > 0 && engine.passes_unchanged() + 1 < self.limit;
        others.ask(engine, &session.edits, engine.passes(), ahead);
        match others.points() {
            Ok(points) => points.is_some(),
            Err(error) => {
                (self.others, self.asked) = (None, false);
                self.tell(true, format!("{error}; rank 0 goes on alone"));
                false
            }
        }
    }

    /// After a frame of points that others have shaded. `has_pass`: it used them.
    pub(super) fn pass_recorded(&mut self, has_pass: bool) {
        self.asked = false;
        if has_pass {
            self.shared_frames += 1;
            self.others.iter_mut().for_each(|others| others.used());
        }
    }
}
