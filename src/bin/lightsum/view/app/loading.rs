//! Loading a scene while the window goes on.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use lightsum::settings::Exposure;
use lightsum::{Error, Result};

use super::super::session::{SIZE, Session};
use super::App;

/// A scene that is being loaded.
pub struct Loading {
    pub(super) path: PathBuf,
    pub(super) done: Receiver<Result<Session>>,
}

impl App<'_> {
    /// Starts loading a scene, on a thread of its own.
    pub(super) fn load(&mut self, path: PathBuf) {
        let Some(stage) = &self.stage else { return };
        if self.others.is_some() && self.session.is_some() {
            let path = path.display();
            return self.tell(true, format!("{path}: the ranks have another scene; start again with this one"));
        }
        let (context, args, file) = (stage.context.clone(), self.args.clone(), path.clone());
        let [.., width, height] = self.image;
        let size =
            if width > 0 && height > 0 { Some([width, height]) } else { self.args.shown.resolution.or(Some(SIZE)) };
        let (send, done) = channel();
        let measured = self.others.is_none();
        std::thread::spawn(move || {
            // Nobody waits for it any more if another scene was opened meanwhile.
            let _ = send.send(Session::open(&context, &file, &args, size, measured));
        });
        self.loading = Some(Loading { path, done });
        self.dirty = true;
    }

    /// Takes a scene that was loaded.
    pub(super) fn loaded(&mut self) {
        let Some(Loading { done, .. }) = &self.loading else { return };
        let loaded = match done.try_recv() {
            Ok(loaded) => loaded,
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => {
                Err(Error::Scene(String::from("the thread that loaded it ended early, as it says on standard error")))
            }
        };
        self.loading = None;
        if let Some(session) = self.check(loaded) {
            (self.panel.notice, self.refused) = (None, None);
            match session.exposure(&self.args) {
                Exposure::Stops(stops) => self.look.stops = stops,
                Exposure::Auto => self.look.auto = true,
            }
            if let Some(stage) = &self.stage {
                stage.window.set_title(&format!("{} - lightsum", session.name));
            }
            self.session = Some(session);
            // The first image is there sooner with fewer lit points.
            self.camera_moved();
        }
        self.touched();
    }
}
