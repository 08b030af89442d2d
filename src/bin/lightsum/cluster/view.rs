//! `view` on several ranks: rank 0 has the window, the others shade the points of its passes. While it filters and shows a pass, they have tasks
//! of the next one, unless the view moves.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use lightsum::cluster::points::Shape;
use lightsum::cluster::{Edits, Message, PassPoints};
use lightsum::engine::Engine;
use lightsum::fingerprint::fingerprint;
use lightsum::settings::Traversal;
use lightsum::view::Task;
use lightsum::{Error, Result, input};

use super::given::{Given, TASKS};
use super::{Master, refuse_flags};
use crate::args::{Sent, View};
use crate::view::{self, Others};

/// Runs the command.
pub fn run(master: &mut Master, args: &View) -> Result<()> {
    let Some(path) = &args.scene else {
        let message = String::from("ranks need a scene from the start: name it");
        return Err(Error::Setting { name: "SCENE", message });
    };
    refuse_flags(&[(args.shown.kept.light_from.is_some(), "--light-from")])?;
    input::keep();
    let (scene, camera, settings) = view::prepare(path, args, None)?;
    let own = fingerprint(&scene, &camera, &settings);
    drop(scene);
    master.load(args.cluster.local_scene, Traversal::Auto)?;
    master.compare(own)?;
    let free: BTreeSet<usize> = master.clients().collect();
    let ranks = Ranks {
        master,
        given: Given::new(Vec::new(), args.cluster_tasks == Sent::PackedTiles),
        wanted: VecDeque::new(),
        begun: 0,
        shape: None,
        spare: Vec::new(),
        edits: Edits::default(),
        told: free.iter().map(|&rank| (rank, 0)).collect(),
        free,
    };
    view::run(args, Some(Box::new(ranks)))
}

/// The ranks that shade points.
struct Ranks<'a, 'b> {
    master: &'a Master<'b>,
    given: Given,
    /// Numbers of the latest edit and of the pass, of the passes that are being shaded.
    wanted: VecDeque<(u64, u32)>,
    /// Passes begun.
    begun: u32,
    /// The shape of their points.
    shape: Option<Shape>,
    /// Memory for points that is not in use.
    spare: Vec<PassPoints>,
    edits: Edits,
    /// The latest edit that each rank knows; of those that are not lost.
    told: BTreeMap<usize, u64>,
    free: BTreeSet<usize>,
}

impl Ranks<'_, '_> {
    /// Gives tasks to ranks that have none, with the edits before them.
    fn give_out(&mut self) {
        for rank in self.free.clone() {
            let Some(shade) = self.given.next(rank) else { break };
            let told = self.told.insert(rank, self.edits.number()).unwrap_or(0);
            let edits = self.edits.since(told);
            // A rank without a task waits for messages, so that no sending waits for it.
            if !edits.is_empty() {
                self.master.link.send(rank, &Message::Edits(edits), &[]);
            }
            self.free.remove(&rank);
            self.master.link.send(rank, &Message::Shade(shade), &[]);
        }
    }
}

impl Others for Ranks<'_, '_> {
    fn ask(&mut self, engine: &Engine, edits: &Edits, pass: u32, ahead: bool) {
        let number = edits.number();
        if self.wanted.front() != Some(&(number, pass)) {
            // Tasks of passes that are no longer wanted are left out as they come in.
            self.wanted.clear();
            self.spare.extend(self.given.passes.drain(..).map(|pass| pass.points));
            let count = (TASKS * self.told.len()) as u32;
            self.given.tasks = Task::cut(&engine.plan().settings, engine.view().size(), count);
            let shape = Shape::of(engine);
            if self.shape.replace(shape) != Some(shape) {
                self.spare.clear();
            }
            self.edits = edits.clone();
        }
        for pass in pass..=pass + u32::from(ahead) {
            if !self.wanted.contains(&(number, pass)) {
                let mut points = self.spare.pop().unwrap_or_else(|| PassPoints::of(engine));
                points.clear();
                self.given.begin(self.begun, pass, points);
                self.begun += 1;
                self.wanted.push_back((number, pass));
            }
        }
        self.give_out();
    }

    fn points(&mut self) -> Result<Option<&mut PassPoints>> {
        while let Some((rank, message, load)) = self.master.link.poll()? {
            match message {
                Message::Shaded(shade) => {
                    self.given.take(rank, &shade, &load)?;
                    self.free.insert(rank);
                }
                Message::Failed(why) => {
                    self.given.lost(rank);
                    self.told.remove(&rank);
                    log::warn!("rank {rank} on {} is lost, others shade its points: {why}", self.master.hosts[rank]);
                    if self.told.is_empty() {
                        return self.master.refuse(rank, why);
                    }
                }
                other => return self.master.refuse(rank, format!("unexpected message {other:?}")),
            }
        }
        self.give_out();
        Ok(self.given.passes.front_mut().map(|pass| &mut pass.points).filter(|points| points.is_complete()))
    }

    fn used(&mut self) {
        self.wanted.pop_front();
        self.spare.extend(self.given.passes.pop_front().map(|pass| pass.points));
    }
}
