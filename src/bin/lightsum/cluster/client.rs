//! A rank that renders what the master asks for.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::cluster::Message;
use lightsum::cluster::message::{Hello, Ready, Shade, Work};
use lightsum::cluster::points::Shape;
use lightsum::output::About;
use lightsum::settings::{Exposure, Traversal};
#[cfg(feature = "viewer")]
use lightsum::standalone::RenderOptions;
use lightsum::standalone::{self, Renderer};
use lightsum::{Error, Result, input, output};
use log::LevelFilter;

use super::{Link, processor_since};
use crate::animate::{Player, Script};
#[cfg(feature = "viewer")]
use crate::args::Sent;
use crate::args::{self, Animate, Arguments, ClusterTasks, Command, Render};
use crate::render::{self, metadata};
#[cfg(feature = "viewer")]
use crate::view;
use crate::{bake, mirrors, shard};

/// Renders until the master ends it. The master is told of errors and prints them.
pub fn run(arguments: &Arguments, link: &Link, hello: Hello) -> Result<()> {
    crate::be_mute();
    // Launchers send signals to all ranks: the master decides.
    if let Err(error) = ctrlc::set_handler(|| {}) {
        log::warn!("an interrupt ends this rank at once: {error}");
    }
    link.send(0, &Message::Hello(hello), &[]);
    let mut client = Client { link, level: log::max_level(), work: Work::default(), start: None };
    if client.level == LevelFilter::Warn {
        // The master reads the same files, and warns.
        log::set_max_level(LevelFilter::Error);
    }
    match client.work(arguments) {
        Ok(()) => {}
        Err(error) => {
            link.send(0, &Message::Failed(error.to_string()), &[]);
            while link.wait()?.1 != Message::End {}
        }
    }
    client.bye();
    Ok(())
}

/// A rank that renders.
struct Client<'a> {
    link: &'a Link,
    /// Of the log, once the scene is read.
    level: LevelFilter,
    work: Work,
    /// When it became ready.
    start: Option<(Instant, ProcessTime, u64)>,
}

impl Client<'_> {
    /// All of it, up to the message that ends it.
    fn work(&mut self, arguments: &Arguments) -> Result<()> {
        let (_, message, _) = self.link.wait()?;
        let Message::Load { files, traversal } = message else { return Ok(()) };
        if let Some(length) = files {
            let mut bytes = vec![0; length as usize];
            self.link.broadcast(&mut bytes);
            input::read_from(&bytes)?;
        }
        match &arguments.command {
            Some(Command::Render(args)) => self.render(args, traversal),
            Some(Command::Animate(args)) => self.animate(args, traversal),
            Some(Command::Bake(args)) => self.bake(args, traversal),
            #[cfg(feature = "viewer")]
            Some(Command::View(args)) => self.view(args, traversal),
            // The master has refused it.
            _ => Ok(()),
        }
    }

    fn ready(&mut self, renderer: &Renderer, about: About) -> Result<()> {
        log::set_max_level(self.level);
        // The files are no longer needed.
        input::read_from(&[])?;
        let provenance = renderer.provenance();
        let ready = Ready {
            fingerprint: renderer.fingerprint(),
            size: renderer.engine().view().size(),
            device: provenance.device,
            traversal: provenance.traversal,
            triangles: renderer.statistics().triangles,
            about,
        };
        self.start.get_or_insert_with(|| (Instant::now(), ProcessTime::now(), self.link.sent()));
        self.link.send(0, &Message::Ready(Box::new(ready)), &[]);
        Ok(())
    }

    /// Renders passes, and hands over their film when asked.
    fn render(&mut self, args: &Render, traversal: Traversal) -> Result<()> {
        let (job, mut scene, moment) = render::prepare(args)?;
        let ends = moment.ends(&scene)?;
        let options = render::options(args, Some(traversal), ends.as_ref());
        mirrors::sample(&mut scene, &job.settings, &options, &AtomicBool::new(false))?;
        let mut renderer = Renderer::new(scene, job.camera, job.settings.clone(), &options)?;
        renderer.set_shutter_ends(ends)?;
        let about = shard::about(metadata(&job, "", String::new()), job.encoding.exposure, &renderer);
        self.ready(&renderer, about)?;
        match self.passes(&mut renderer)? {
            Message::End => Ok(()),
            other => Err(strange(&other)),
        }
    }

    /// Renders the parts of a bake, pass by pass.
    fn bake(&mut self, args: &args::Bake, traversal: Traversal) -> Result<()> {
        let (scene, settings) = bake::prepare(args)?;
        let (context, settings) = standalone::open(settings, &bake::options(args, Some(traversal)))?;
        let baked = lightsum::bake::Bake::new(&context, &scene, settings.clone(), args.options())?;
        let about =
            |renderer: &Renderer| shard::about(bake::metadata(&scene, &settings), Exposure::default(), renderer);
        let mut renderer = baked.renderer(0, None)?;
        self.ready(&renderer, about(&renderer))?;
        loop {
            match self.passes(&mut renderer)? {
                Message::Part(part) => {
                    renderer = baked.renderer(part as usize, Some(renderer))?;
                    self.ready(&renderer, about(&renderer))?;
                }
                Message::End => return Ok(()),
                other => return Err(strange(&other)),
            }
        }
    }

    /// Renders passes, and hands over their film when asked, until another message comes, which it returns.
    fn passes(&mut self, renderer: &mut Renderer) -> Result<Message> {
        loop {
            match self.link.wait()?.1 {
                Message::Pass(number) => {
                    let start = Instant::now();
                    let kept = renderer.pass_of(number)?;
                    let seconds = start.elapsed().as_secs_f64();
                    self.work.passes += 1;
                    self.work.rendering += seconds;
                    self.link.send(0, &Message::Rendered { kept, seconds }, &[]);
                }
                Message::Deliver => {
                    let film = renderer.film()?.canonical().to_bytes();
                    self.link.send(0, &Message::Film, &film);
                    renderer.engine_mut().restart();
                }
                other => return Ok(other),
            }
        }
    }

    /// Renders frames, and sends their files.
    fn animate(&mut self, args: &Animate, traversal: Traversal) -> Result<()> {
        let (script, scene) = Script::new(args)?;
        let mut player = Player::new(script, scene, Some(traversal), &AtomicBool::new(false))?;
        let job = &player.script.job;
        let about = shard::about(metadata(job, "", String::new()), job.encoding.exposure, &player.renderer);
        self.ready(&player.renderer, about)?;
        let mut placed = None;
        loop {
            match self.link.wait()?.1 {
                Message::Shade(shade) => {
                    let start = Instant::now();
                    if placed != Some(shade.frame) {
                        player.place(shade.frame as usize)?;
                        placed = Some(shade.frame);
                    }
                    self.shade(&mut player.renderer, shade, args.cluster_tasks == ClusterTasks::PackedTiles, start)?;
                }
                Message::Frames([first, end]) => {
                    for number in first..end {
                        self.frame(&mut player, number)?;
                    }
                }
                Message::End => return Ok(()),
                other => return Err(strange(&other)),
            }
        }
    }

    /// Shades the points of a task, begun at `start`, and sends them.
    fn shade(&mut self, renderer: &mut Renderer, shade: Shade, packed: bool, start: Instant) -> Result<()> {
        let points = renderer.points_of(shade.pass, &shade.task)?;
        let engine = renderer.engine();
        let points = match packed {
            true => points.pack(&Shape::of(engine), &engine.plan().parameters(shade.pass)?),
            false => points.to_bytes(),
        };
        self.work.rendering += start.elapsed().as_secs_f64();
        self.work.passes += 1;
        self.link.send(0, &Message::Shaded(shade), &points);
        Ok(())
    }

    /// Shades points of a window's images, as edits make them.
    #[cfg(feature = "viewer")]
    fn view(&mut self, args: &args::View, traversal: Traversal) -> Result<()> {
        let Some(path) = &args.scene else { return Ok(()) };
        let (scene, camera, settings) = view::prepare(path, args, None)?;
        let device = &args.shown.device;
        let options = RenderOptions {
            device: device.device.clone().unwrap_or_default(),
            validation: device.validation,
            max_memory: device.max_device_memory,
            pipeline_cache: render::pipeline_cache(),
            traversal: Some(traversal),
            dynamic: true,
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(scene, camera, settings, &options)?;
        self.ready(&renderer, About::default())?;
        loop {
            match self.link.wait()?.1 {
                Message::Edits(edits) => {
                    edits.into_iter().try_for_each(|edit| edit.apply(renderer.engine_mut()))?;
                }
                Message::Shade(shade) => {
                    self.shade(&mut renderer, shade, args.cluster_tasks == Sent::PackedTiles, Instant::now())?;
                }
                Message::End => return Ok(()),
                other => return Err(strange(&other)),
            }
        }
    }

    fn frame(&mut self, player: &mut Player, number: u32) -> Result<()> {
        let start = Instant::now();
        let frame = player.frame(number as usize)?;
        self.work.rendering += start.elapsed().as_secs_f64();
        self.work.passes += player.script.job.settings.moving_passes;
        let mut timings = frame.timings;
        let write = Instant::now();
        let file = match (frame.image, player.script.output(number as usize)) {
            (Some((layers, metadata)), Some(path)) => {
                output::encode(&path, &layers, &metadata, &player.script.job.encoding)?
            }
            _ => Vec::new(),
        };
        timings["write"] = write.elapsed().as_secs_f64().into();
        self.link.send(0, &Message::Frame { number, timings }, &file);
        Ok(())
    }

    /// The last message.
    fn bye(mut self) {
        if let Some((wall, processor, bytes)) = self.start {
            self.work.wall = wall.elapsed().as_secs_f64();
            self.work.processor = processor_since(processor);
            self.work.bytes = self.link.sent() - bytes;
        }
        self.link.send(0, &Message::Bye(self.work), &[]);
    }
}

fn strange(message: &Message) -> Error {
    Error::Resource { name: String::from("MPI"), message: format!("unexpected message {message:?}") }
}
