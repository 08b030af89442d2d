//! Messages between the master, rank 0, and the other ranks.
//!
//! A message is a text (JSON), of a few hundred bytes, and a load: the sums of a film, a file. As bytes: length of the text u32, length of the load u64,
//! the text, the load, little endian.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Edit;
use crate::output::About;
use crate::settings::Traversal;
use crate::view::Task;

/// Bytes before the text.
pub const HEAD: usize = 12;
/// Most bytes of a text.
const MAX_TEXT: u32 = 1 << 24;

/// A message from a rank.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// To the master, first: who I am.
    Hello(Hello),
    /// To all: read the scene; from the files that follow, or from my own machine.
    Load {
        /// Bytes of the files, which are broadcast.
        files: Option<u64>,
        /// The traversal kernel that all use where the flags leave it open.
        traversal: Traversal,
    },
    /// To the master: my device is open, I can render.
    Ready(Box<Ready>),
    /// To the master: I cannot go on, because of this.
    Failed(String),
    /// To a rank: render the pass of this number.
    Pass(u32),
    /// To the master: the pass is in my film, or was left out. Asks for a task.
    Rendered {
        /// Whether it is in the film.
        kept: bool,
        /// Seconds of the pass.
        seconds: f64,
    },
    /// To a rank: hand over your film.
    Deliver,
    /// To the master: here it is, in the load; I begin another. Asks for a task.
    Film,
    /// To all: render this part of a bake from now on, and tell what it is.
    Part(u32),
    /// To a rank: render these frames of the animation.
    Frames([u32; 2]),
    /// To the master: a frame; the load is its file. The last one of a task asks for a task.
    Frame {
        /// Its number.
        number: u32,
        /// Its times.
        timings: Value,
    },
    /// To a rank: what has changed in camera, settings and scene since the edits before.
    Edits(Vec<Edit>),
    /// To a rank: shade the points of this task in a pass of a frame.
    Shade(Shade),
    /// To the master: they are in the load. Asks for a task.
    Shaded(Shade),
    /// To a rank: nothing is left, or someone failed.
    End,
    /// To the master, last: what it took me.
    Bye(Work),
}

/// A part of a pass of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shade {
    /// Number of the frame; in a window that of the pass among all that were begun.
    pub frame: u32,
    /// Number of the pass in what the frame accumulates.
    pub pass: u32,
    /// Its pixels.
    pub task: Task,
}

/// Identity of a rank.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the program.
    pub version: String,
    /// Arguments of the command line.
    pub arguments: Vec<String>,
    /// Name of the machine.
    pub host: String,
}

impl Hello {
    /// Why a rank does not belong to the master's job; `None`: it does.
    pub fn differs(&self, master: &Hello) -> Option<String> {
        if self.version != master.version {
            return Some(format!(
                "it runs lightsum {}, rank 0 runs {}; install one version on all machines",
                self.version, master.version
            ));
        }
        if self.arguments != master.arguments {
            let given = self.arguments.join(" ");
            return Some(format!("it was started with other arguments: {given}; give all ranks the same"));
        }
        None
    }
}

/// The work of a rank, and its means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ready {
    /// Of scene, camera and settings.
    pub fingerprint: u64,
    /// Width and height of the film.
    pub size: [u32; 2],
    /// Device and driver: their identity.
    pub device: String,
    /// The traversal kernel.
    pub traversal: Traversal,
    /// Triangles of the scene.
    pub triangles: u64,
    /// The scene and its settings.
    pub about: About,
}

impl Ready {
    /// Why two ranks do not render the same; `None`: they do.
    pub fn differs(&self, other: &Ready) -> Option<&'static str> {
        if self.size != other.size || self.fingerprint != other.fingerprint {
            return Some("its scene differs: with --local-scene all machines must have the same files");
        }
        (self.traversal != other.traversal)
            .then_some("its device has another traversal kernel; give --traversal single")
    }
}

/// Cost of the work of a rank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Passes rendered, or tasks.
    pub passes: u32,
    /// Seconds from the first task to the end.
    pub wall: f64,
    /// Seconds of these in passes.
    pub rendering: f64,
    /// Processor seconds from the first task to the end.
    pub processor: f64,
    /// Bytes sent to the master.
    pub bytes: u64,
}

impl Message {
    /// The text with its head, for a load of `load` bytes.
    pub fn to_bytes(&self, load: u64) -> Vec<u8> {
        // Strings, numbers and maps with strings as keys: serialisation cannot fail.
        let text = serde_json::to_vec(self).unwrap_or_default();
        let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
        bytes.extend(load.to_le_bytes());
        bytes.extend(text);
        bytes
    }

    /// The message of [`Message::to_bytes`], and the number of bytes of its load. Errors: it is none.
    pub fn from_bytes(bytes: &[u8]) -> Result<(Message, u64), String> {
        let (head, text) = bytes.split_at_checked(HEAD).ok_or("a message is too short")?;
        let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]);
        if length > MAX_TEXT || length as usize != text.len() {
            return Err(format!("a message of {} bytes says that it has {length}", text.len()));
        }
        let load = u64::from_le_bytes(std::array::from_fn(|i| head[4 + i]));
        let message = serde_json::from_slice(text).map_err(|error| format!("a message is unreadable: {error}"))?;
        Ok((message, load))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Region;

    fn hello() -> Hello {
        Hello { version: "1".into(), arguments: vec!["render".into(), "a.toml".into()], host: "node".into() }
    }

    #[test]
    fn messages_come_back() {
        let ready = Ready {
            fingerprint: u64::MAX - 1,
            size: [3, 2],
            device: "a device".into(),
            traversal: Traversal::Single,
            triangles: 12,
            about: About { camera: "{\"fov\":1.5}".into(), exposure: Some(-0.3), ..About::default() },
        };
        let region = Region { origin: [0, 24], size: [83, 24] };
        let shade = Shade { frame: 2, pass: 1, task: Task { region, class: Some(8) } };
        let timings = serde_json::json!({ "seconds": 0.25 });
        for message in [
            Message::Hello(hello()),
            Message::Load { files: Some(5), traversal: Traversal::Auto },
            Message::Ready(Box::new(ready)),
            Message::Failed("no device".into()),
            Message::Pass(7),
            Message::Rendered { kept: true, seconds: 0.1 },
            Message::Frame { number: 3, timings },
            Message::Shade(shade),
            Message::Shaded(shade),
            Message::Bye(Work { passes: 3, wall: 1.0, rendering: 0.5, processor: 0.7, bytes: 1 << 40 }),
            Message::End,
        ] {
            assert_eq!(Message::from_bytes(&message.to_bytes(1 << 33)).unwrap(), (message, 1 << 33));
        }
    }

    #[test]
    fn damaged_messages_are_told() {
        let whole = Message::Pass(7).to_bytes(0);
        for bytes in [&whole[..3], &whole[..whole.len() - 1], &[0xff; 40]] {
            assert!(Message::from_bytes(bytes).is_err());
        }
        let mut other = whole.clone();
        other[HEAD + 2] = b'?';
        assert!(Message::from_bytes(&other).unwrap_err().contains("unreadable"));
    }

    #[test]
    fn ranks_of_another_job_are_told_apart() {
        assert_eq!(hello().differs(&hello()), None);
        let newer = Hello { version: "2".into(), ..hello() };
        assert!(newer.differs(&hello()).unwrap().contains("lightsum 2"));
        let other = Hello { arguments: vec!["render".into(), "b.toml".into()], ..hello() };
        assert!(other.differs(&hello()).unwrap().contains("b.toml"));
    }
}
