//! The image while it is rendered: files that are rewritten, and tev, a viewer that is sent the image.

use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use lightsum::output::Wanted;
use lightsum::standalone::Renderer;
use lightsum::{Error, Result};
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use crate::args::Output;

/// Time between two images that are sent.
const EVERY: Duration = Duration::from_millis(500);
/// Time that tev may take to accept a connection or a part of the image.
const PATIENCE: Duration = Duration::from_secs(10);
/// Maximum bytes of a packet's pixels, so that tev shows the image part by part.
const PACKET: usize = 1 << 20;
/// Names of the channels.
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Shows the image while it is rendered.
pub struct Live {
    /// Time between two rewritings of the files.
    preview: Option<Duration>,
    written: Instant,
    display: Option<Display>,
}

/// A connection to tev.
struct Display {
    client: TevClient,
    address: String,
    name: String,
    /// Size of the image that tev has.
    size: Option<[u32; 2]>,
    sent: Option<Instant>,
}

impl Live {
    /// By the flags, for an image of this name. Errors: nobody listens at the address of `--display`.
    pub fn new(flags: &Output, name: &str) -> Result<Live> {
        let display = flags.display.as_deref().map(|address| Display::connect(address, name)).transpose()?;
        Ok(Live { preview: flags.preview, written: Instant::now(), display })
    }

    /// Writes and sends the image if it is time. A failure ends that and is told; the rendering goes on.
    pub fn after_pass(&mut self, renderer: &Renderer, write: impl FnOnce() -> Result<()>) {
        if self.preview.is_some_and(|every| self.written.elapsed() >= every) {
            if let Err(error) = write() {
                log::warn!("no more previews are written: {error}");
                self.preview = None;
            }
            self.written = Instant::now();
        }
        if self.display.as_ref().is_some_and(|display| display.sent.is_none_or(|sent| sent.elapsed() >= EVERY)) {
            self.send(renderer);
        }
    }

    /// Sends the final image.
    pub fn end(&mut self, renderer: &Renderer) {
        self.send(renderer);
    }

    fn send(&mut self, renderer: &Renderer) {
        let Some(display) = &mut self.display else { return };
        if let Err(why) = display.send(renderer) {
            log::warn!("{}: the image is no longer shown, the rendering goes on: {why}", display.address);
            self.display = None;
        }
    }
}

impl Display {
    fn connect(address: &str, name: &str) -> Result<Display> {
        let open = || -> std::io::Result<TcpStream> {
            let mut last = std::io::Error::from(std::io::ErrorKind::NotFound);
            for place in address.to_socket_addrs()? {
                match TcpStream::connect_timeout(&place, PATIENCE) {
                    Ok(stream) => return stream.set_write_timeout(Some(PATIENCE)).map(|()| stream),
                    Err(error) => last = error,
                }
            }
            Err(last)
        };
        let stream = open().map_err(|error| Error::Resource {
            name: format!("--display {address}"),
            message: format!("no connection: {error}; start tev there first, or leave out the flag"),
        })?;
        // The protocol ends names by a 0.
        let name = format!("lightsum {}", name.replace('\0', ""));
        Ok(Display { client: TevClient::wrap(stream), address: address.to_owned(), name, size: None, sent: None })
    }

    fn send(&mut self, renderer: &Renderer) -> Result<(), String> {
        let image = renderer.image(Wanted::Color).map_err(|error| error.to_string())?;
        let size = [image.width, image.height];
        if self.size != Some(size) {
            let packet = PacketCreateImage {
                image_name: &self.name,
                grab_focus: true,
                width: image.width,
                height: image.height,
                channel_names: &CHANNELS,
            };
            self.client.send(packet).map_err(|error| error.to_string())?;
            self.size = Some(size);
        }
        let row = image.width as usize;
        let rows = (PACKET / (12 * row)).max(1);
        for (part, colors) in image.color.chunks(rows * row).enumerate() {
            let data: Vec<f32> = colors.iter().flat_map(|color| color.to_array()).collect();
            let packet = PacketUpdateImage {
                image_name: &self.name,
                grab_focus: false,
                channel_names: &CHANNELS,
                channel_offsets: &[0, 1, 2],
                channel_strides: &[3, 3, 3],
                x: 0,
                y: (part * rows) as u32,
                width: image.width,
                height: (colors.len() / row) as u32,
                data: &data,
            };
            self.client.send(packet).map_err(|error| error.to_string())?;
        }
        self.sent = Some(Instant::now());
        Ok(())
    }
}
