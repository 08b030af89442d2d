//! Values of keys: read from texts and from TOML, and as types of the settings.

use std::fmt::{Display, Formatter};

use super::{Key, Takes};
use crate::pass::convolve;
use crate::ring;
use crate::settings::{
    Agreement, ClusterOrder, Compensation, Exposure, GlossyForm, ImageChoice, LightChoice, Lookup, MirrorForm, Preset,
    Reflectance, Sequence, ShadowForm, Spread, Traversal, Window,
};

/// A value of a key.
#[derive(Clone, Debug, PartialEq)]
pub enum Given {
    /// The key's word for no value.
    Nothing,
    /// Of a switch.
    Switch(bool),
    /// A whole number.
    Count(u64),
    /// A number.
    Number(f32),
    /// Width and height.
    Size([u32; 2]),
    /// One of the key's words.
    Word(&'static str),
}

impl Display for Given {
    fn fmt(&self, f: &mut Formatter) -> std::fmt::Result {
        match self {
            Given::Nothing => f.write_str("nothing"),
            Given::Switch(on) => write!(f, "{on}"),
            Given::Count(n) => write!(f, "{n}"),
            Given::Number(v) => write!(f, "{v}"),
            Given::Size([width, height]) => write!(f, "{width}x{height}"),
            Given::Word(word) => f.write_str(word),
        }
    }
}

impl Key {
    /// Reads a value. Errors: the values that are expected.
    pub fn parse(&self, text: &str) -> Result<Given, String> {
        let text = text.trim();
        let word = self.word(text);
        let value = match (word, self.takes) {
            (Some(word), _) if Some(word) == self.nothing => Some(Given::Nothing),
            (Some(word), _) => Some(Given::Word(word)),
            (None, Takes::Switch) => text.parse().ok().map(Given::Switch),
            (None, Takes::Count { .. }) => text.parse().ok().map(Given::Count),
            (None, Takes::Bytes) => bytes(text).map(Given::Count),
            (None, Takes::Number { .. }) => text.parse().ok().map(Given::Number),
            (None, Takes::Size { .. }) => size(text).map(Given::Size),
            (None, Takes::Words) => None,
        };
        value.filter(|value| self.allows(value)).ok_or_else(|| format!("expected {}", self.expected()))
    }

    /// One of its words, written with dashes or underscores. `compensation` was a switch.
    fn word(&self, text: &str) -> Option<&'static str> {
        let text = match (self.name, text) {
            ("compensation", "false") => "off",
            ("compensation", "true") => "exact",
            ("filter_agreement", "paper") => "depth-and-normal",
            _ => text,
        };
        let is = |word: &&str| *word == text || *word == text.replace('_', "-");
        self.words.iter().map(|(word, _)| *word).find(is)
    }

    /// Reads a value of TOML. Errors: the values that are expected.
    pub fn read(&self, value: &toml::Value) -> Result<Given, String> {
        let given = match value {
            toml::Value::String(text) => return self.parse(text),
            toml::Value::Array(list) => match (self.takes, list.as_slice()) {
                (Takes::Size { .. }, [width, height]) => {
                    let side = |value: &toml::Value| value.as_integer().and_then(|n| u32::try_from(n).ok());
                    side(width).zip(side(height)).map(|(width, height)| Given::Size([width, height]))
                }
                _ => None,
            },
            toml::Value::Float(number) if matches!(self.takes, Takes::Number { .. }) => {
                Some(Given::Number(*number as f32))
            }
            toml::Value::Integer(_) | toml::Value::Boolean(_) => return self.parse(&value.to_string()),
            _ => None,
        };
        given.filter(|given| self.allows(given)).ok_or_else(|| format!("expected {}", self.expected()))
    }
}

/// Two whole numbers with an x between them, or as a list.
fn size(text: &str) -> Option<[u32; 2]> {
    let (width, height) = match text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
        Some(list) => list.split_once(',')?,
        None => text.split_once(['x', 'X'])?,
    };
    Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
}

/// A number of bytes, with K, M, G or T for powers of 1024.
fn bytes(text: &str) -> Option<u64> {
    let unit = text.char_indices().last().filter(|(_, c)| c.is_ascii_alphabetic());
    let Some((at, unit)) = unit else { return text.parse().ok() };
    let power = ['K', 'M', 'G', 'T'].iter().position(|u| u.eq_ignore_ascii_case(&unit))? + 1;
    text[..at].parse::<u64>().ok()?.checked_mul(1 << (10 * power))
}

/// A type of values.
pub(super) trait Value: Sized {
    /// The value, if it is of this type.
    fn of(given: &Given) -> Option<Self>;
    /// The reverse.
    fn given(&self) -> Given;
}

impl Value for bool {
    fn of(given: &Given) -> Option<bool> {
        if let Given::Switch(on) = given { Some(*on) } else { None }
    }
    fn given(&self) -> Given {
        Given::Switch(*self)
    }
}

impl Value for u32 {
    fn of(given: &Given) -> Option<u32> {
        if let Given::Count(n) = given { u32::try_from(*n).ok() } else { None }
    }
    fn given(&self) -> Given {
        Given::Count(u64::from(*self))
    }
}

impl Value for u64 {
    fn of(given: &Given) -> Option<u64> {
        if let Given::Count(n) = given { Some(*n) } else { None }
    }
    fn given(&self) -> Given {
        Given::Count(*self)
    }
}

impl Value for f32 {
    fn of(given: &Given) -> Option<f32> {
        if let Given::Number(v) = given { Some(*v) } else { None }
    }
    fn given(&self) -> Given {
        Given::Number(*self)
    }
}

impl Value for [u32; 2] {
    fn of(given: &Given) -> Option<[u32; 2]> {
        if let Given::Size(size) = given { Some(*size) } else { None }
    }
    fn given(&self) -> Given {
        Given::Size(*self)
    }
}

impl<T: Value> Value for Option<T> {
    fn of(given: &Given) -> Option<Option<T>> {
        if *given == Given::Nothing { Some(None) } else { T::of(given).map(Some) }
    }
    fn given(&self) -> Given {
        self.as_ref().map_or(Given::Nothing, T::given)
    }
}

impl Value for Window {
    fn of(given: &Given) -> Option<Window> {
        match given {
            Given::Word("auto") => Some(Window::Auto),
            Given::Size(size) => Some(Window::Size(*size)),
            _ => None,
        }
    }
    fn given(&self) -> Given {
        match self {
            Window::Auto => Given::Word("auto"),
            Window::Size(size) => Given::Size(*size),
        }
    }
}

impl Value for Exposure {
    fn of(given: &Given) -> Option<Exposure> {
        match given {
            Given::Word("auto") => Some(Exposure::Auto),
            Given::Number(stops) => Some(Exposure::Stops(*stops)),
            _ => None,
        }
    }
    fn given(&self) -> Given {
        match self {
            Exposure::Auto => Given::Word("auto"),
            Exposure::Stops(stops) => Given::Number(*stops),
        }
    }
}

/// Types whose values are words.
macro_rules! words {
    ($($kind:ty { $($variant:ident = $word:literal),+ })+) => {$(
        impl Value for $kind {
            fn of(given: &Given) -> Option<Self> {
                match given {
                    $(Given::Word($word) => Some(<$kind>::$variant),)+
                    _ => None,
                }
            }
            fn given(&self) -> Given {
                Given::Word(match self {
                    $(<$kind>::$variant => $word,)+
                })
            }
        }
    )+};
}

words! {
    Agreement { Plane = "plane", DepthAndNormal = "depth-and-normal" }
    ClusterOrder { Screen = "screen", Space = "space" }
    Compensation { Off = "off", Near = "near", Exact = "exact" }
    GlossyForm { Paths = "paths", Splats = "splats" }
    ImageChoice { Angle = "angle", Distance = "distance" }
    LightChoice { Power = "power", Contribution = "contribution" }
    Lookup { Bilinear = "bilinear", Bicubic = "bicubic" }
    MirrorForm { Rays = "rays", Images = "images" }
    Preset { Progressive = "progressive", Interactive = "interactive" }
    Reflectance { Schlick = "schlick", Map = "map", Fresnel = "fresnel" }
    Sequence { Halton = "halton", Sobol = "sobol" }
    ShadowForm { Off = "off", Splat = "splat" }
    Spread { Mirror = "mirror", Invariant = "invariant", Variant = "variant" }
    Traversal { Auto = "auto", Single = "single", Cluster = "cluster" }
    convolve::Form { Auto = "auto", Direct = "direct", Fast = "fast" }
    ring::Form { Images = "images", Lights = "lights" }
}
