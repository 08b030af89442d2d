//! The image while it is rendered: files that are rewritten, and tev's protocol against a listener.

use std::fs;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::process::Stdio;
use std::thread::{self, JoinHandle};

use crate::render::{channels, command, fails, folder, kill, text};

/// Flags for few kernels and quick passes.
const QUICK: &str =
    "--particles 2 --max-depth 2 --traversal single --compensation off --interleave 1x1 --no-antialias --light-pool 0";

/// A packet of tev's protocol without its length: numbers are little endian, names end in 0.
struct Packet(Vec<u8>);

impl Packet {
    /// The next packet; `None` at the end of the stream.
    fn read(stream: &mut TcpStream) -> Option<Packet> {
        let mut length = [0; 4];
        stream.read_exact(&mut length).ok()?;
        // The length counts itself.
        let mut bytes = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut bytes).expect("a packet is as long as it says");
        Some(Packet(bytes))
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        self.0.drain(..N).collect::<Vec<_>>().try_into().unwrap()
    }

    fn number(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn long(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    fn name(&mut self) -> String {
        let end = self.0.iter().position(|&byte| byte == 0).expect("a name ends in 0");
        let name = self.0.drain(..=end).collect::<Vec<_>>();
        String::from_utf8(name[..end].to_vec()).unwrap()
    }

    fn names(&mut self) -> Vec<String> {
        (0..self.number()).map(|_| self.name()).collect()
    }
}

/// The image as a listener has received it: size, and the pixels of each channel.
#[derive(Debug, Default)]
struct Told {
    size: [u32; 2],
    pixels: Vec<[f32; 3]>,
    updates: u32,
}

impl Told {
    fn take(&mut self, mut packet: Packet) {
        let [kind, focus] = packet.take();
        assert!(packet.name().starts_with("lightsum "), "the image has a name");
        match kind {
            // CreateImage
            4 => {
                assert_eq!((self.pixels.len(), focus), (0, 1), "one image is made");
                self.size = [packet.number(), packet.number()];
                assert_eq!(packet.names(), ["R", "G", "B"]);
                self.pixels = vec![[f32::NAN; 3]; (self.size[0] * self.size[1]) as usize];
            }
            // UpdateImage, version 3
            6 => {
                assert_eq!((focus, packet.names()), (0, ["R", "G", "B"].map(String::from).to_vec()));
                let [x, y, width, height] = [(); 4].map(|()| packet.number());
                assert_eq!((x, width), (0, self.size[0]));
                let offsets = [(); 3].map(|()| packet.long());
                let strides = [(); 3].map(|()| packet.long());
                assert_eq!(packet.0.len() as u64, 4 * 3 * u64::from(width * height));
                let float = |i: u64| {
                    let at = 4 * i as usize;
                    f32::from_le_bytes(packet.0[at..at + 4].try_into().unwrap())
                };
                for i in 0..width * height {
                    let pixel = [0, 1, 2].map(|c| float(offsets[c] + u64::from(i) * strides[c]));
                    self.pixels[(y * self.size[0] + i) as usize] = pixel;
                }
                packet.0.clear();
                self.updates += 1;
            }
            kind => panic!("packet of kind {kind}"),
        }
        assert!(packet.0.is_empty(), "{} bytes are left", packet.0.len());
    }
}

/// Listens for one connection; `keep`: to its end, else up to the first packet.
fn listen(keep: bool) -> (String, JoinHandle<Told>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let heard = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut told = Told::default();
        while let Some(packet) = Packet::read(&mut stream) {
            told.take(packet);
            if !keep {
                break;
            }
        }
        told
    });
    (address, heard)
}

#[test]
fn a_viewer_is_sent_the_image() {
    let folder = folder();
    let (address, heard) = listen(true);
    let line = format!("render scene.toml --passes 3 --float -o a.exr --display {address} {QUICK}");
    let output = command(folder.path(), &line).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let told = heard.join().unwrap();
    assert!(told.size == [20, 16] && told.updates >= 2, "the first pass and the last: {told:?}");
    let image = channels(&folder.path().join("a.exr"));
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        let shown: Vec<f32> = told.pixels.iter().map(|pixel| pixel[c]).collect();
        assert_eq!(shown, image[name], "{name}");
    }
}

#[test]
fn a_lost_viewer_does_not_stop_the_rendering() {
    let folder = folder();
    let (address, heard) = listen(false);
    // Large enough that the system cannot take in what nobody reads.
    let line = format!("render scene.toml --resolution 200x160 --passes 4 -o a.png --display {address} {QUICK}");
    let output = command(folder.path(), &line).output().unwrap();
    heard.join().unwrap();
    let said = text(&output.stderr);
    assert!(output.status.success() && folder.path().join("a.png").exists(), "{said}");
    let lines: Vec<&str> = said.lines().filter(|line| line.contains(&address)).collect();
    assert!(lines.len() == 1 && lines[0].contains("goes on"), "{said}");

    // Nobody listens there any more.
    fails(folder.path(), &format!("render scene.toml -o b.png --display {address}"), 1, &[&address, "tev"]);
    fails(folder.path(), "render scene.toml -o b.png --display nowhere", 2, &["HOST:PORT"]);
}

#[test]
fn previews_are_whole_images() {
    let folder = folder();
    let path = folder.path().join("a.png");
    let mut run =
        command(folder.path(), &format!("render scene.toml --passes 1000000 --preview 0.01 -o a.png {QUICK}"));
    let mut run = run.stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    let mut different = Vec::new();
    while different.len() < 3 {
        assert!(run.try_wait().unwrap().is_none(), "the rendering ended early");
        if let Ok(bytes) = fs::read(&path) {
            let image = image::load_from_memory(&bytes).expect("a preview is a whole image").into_rgb8();
            if different.last() != Some(&image) {
                different.push(image);
            }
        }
        thread::yield_now();
    }
    kill(&run, "TERM");
    assert!(run.wait().unwrap().success());
}
