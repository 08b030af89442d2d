//! Mattes by name in the manner of Cryptomatte (Friedman and Jones 2015; specification 1.2), which compositing programs read: for each pixel the
//! hash of the name of what it shows, as a float, and how much of the pixel that is. The manifest, an attribute of the file, has the
//! names and their hashes.
//!
//! Differs from the specification in nothing; but mattes hold one rank with the surface at the centre of the pixel, so that coverage is 0 or
//! 1.

use std::collections::BTreeMap;

/// A layer of mattes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mattes {
    /// Its name.
    pub layer: &'static str,
    /// Hash of the name of what each pixel shows; 0: nothing.
    pub id: Vec<f32>,
    /// 1 where something is shown, else 0.
    pub coverage: Vec<f32>,
    /// Zeros, for the second rank.
    pub none: Vec<f32>,
    /// Names with their hashes, as JSON.
    manifest: String,
}

impl Mattes {
    /// Of numbers of things with these names; numbers below 0 are nothing. Things of one name are one matte.
    pub fn new(layer: &'static str, numbers: &[f32], names: &[String]) -> Mattes {
        let hashes: Vec<u32> = names.iter().map(|name| as_float(hash(name.as_bytes()))).collect();
        let of = |number: f32| if number < 0.0 { None } else { hashes.get(number as usize).copied() };
        let listed: BTreeMap<&str, String> =
            names.iter().zip(&hashes).map(|(name, hash)| (name.as_str(), format!("{hash:08x}"))).collect();
        Mattes {
            layer,
            id: numbers.iter().map(|&n| f32::from_bits(of(n).unwrap_or(0))).collect(),
            coverage: numbers.iter().map(|&n| if of(n).is_some() { 1.0 } else { 0.0 }).collect(),
            none: vec![0.0; numbers.len()],
            manifest: serde_json::to_string(&listed).unwrap_or_default(),
        }
    }

    /// Channels by name: identifier and coverage, first rank, then second.
    pub fn channels(&self) -> [(String, &[f32]); 4] {
        let values = [("R", &self.id), ("G", &self.coverage), ("B", &self.none), ("A", &self.none)];
        values.map(|(channel, values)| (format!("{}00.{channel}", self.layer), values.as_slice()))
    }

    /// Attributes of the file.
    pub fn attributes(&self) -> [(String, &str); 4] {
        let key = format!("{:08x}", hash(self.layer.as_bytes()));
        let texts = [
            ("name", self.layer),
            ("hash", "MurmurHash3_32"),
            ("conversion", "uint32_to_float32"),
            ("manifest", &self.manifest),
        ];
        texts.map(|(what, text)| (format!("cryptomatte/{}/{what}", &key[..7]), text))
    }
}

/// The bits of a float for a hash: one that is neither a denormal nor no number.
fn as_float(hash: u32) -> u32 {
    match hash >> 23 & 255 {
        0 | 255 => hash ^ 1 << 23,
        _ => hash,
    }
}

/// MurmurHash3 of 32 bits (Appleby, x86_32), seed 0.
fn hash(text: &[u8]) -> u32 {
    let mix = |k: u32| k.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
    let words = text.chunks_exact(4);
    let rest = words.remainder();
    let mut h = 0u32;
    for word in words {
        let k = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
        h = (h ^ mix(k)).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64);
    }
    let last = rest.iter().rev().fold(0, |k, &byte| k << 8 | u32::from(byte));
    h ^= mix(last) ^ text.len() as u32;
    h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
    h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    h ^ h >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_others() {
        for (text, expected) in [
            ("", 0),
            ("hello", 0x248b_fa47),
            ("hello, world", 0x149b_bb7f),
            ("The quick brown fox jumps over the lazy dog", 0x2e4f_f723),
        ] {
            assert_eq!(hash(text.as_bytes()), expected, "{text:?}");
        }
    }

    #[test]
    fn identifiers_are_numbers() {
        for (hash, expected) in [
            (0, 0x0080_0000),
            (0x8012_3456, 0x8092_3456),
            (0x7f80_0001, 0x7f00_0001),
            (0xffff_ffff, 0xff7f_ffff),
            (0x3f80_0000, 0x3f80_0000),
        ] {
            assert_eq!(as_float(hash), expected, "{hash:x}");
            assert!(f32::from_bits(as_float(hash)).is_normal());
        }
    }

    #[test]
    fn mattes_have_names() {
        let names = ["lamp", "floor", "lamp"].map(String::from);
        let mattes = Mattes::new("CryptoObject", &[2.0, -1.0, 1.0, 0.0, 9.0], &names);
        let id = |name: &str| f32::from_bits(as_float(hash(name.as_bytes())));
        assert_eq!(mattes.id, [id("lamp"), 0.0, id("floor"), id("lamp"), 0.0]);
        assert_eq!(mattes.coverage, [1.0, 0.0, 1.0, 1.0, 0.0]);
        let manifest: BTreeMap<String, String> = serde_json::from_str(&mattes.manifest).unwrap();
        assert_eq!(manifest["lamp"], format!("{:08x}", id("lamp").to_bits()));
        assert_eq!(manifest.len(), 2);
        let [name, ..] = mattes.attributes();
        // The specification's own example of a layer's key.
        assert_eq!(
            name,
            (format!("cryptomatte/{}/name", &format!("{:08x}", hash(b"CryptoObject"))[..7]), "CryptoObject")
        );
    }
}
