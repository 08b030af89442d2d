//! The features that a kernel uses of a driver, read from its SPIR-V (numbers of the SPIR-V specification, 1.6, and of GLSL.std.450).

use std::collections::BTreeSet;

use crate::gpu::Shader;

const HEADER_WORDS: usize = 5;
const STORAGE_WORKGROUP: u32 = 4;
const STORAGE_PUSH_CONSTANT: u32 = 9;
const DECORATION_ARRAY_STRIDE: u32 = 6;

/// The features of SPIR-V that a kernel uses, in words.
pub fn features(shader: &Shader) -> BTreeSet<&'static str> {
    let words: Vec<u32> =
        (shader.spirv.chunks_exact(4)).map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect();
    let mut found = BTreeSet::new();
    let mut rest = words.get(HEADER_WORDS..).unwrap_or_default();
    while let Some(&first) = rest.first() {
        let count = ((first >> 16) as usize).clamp(1, rest.len());
        let (instruction, after) = rest.split_at(count);
        found.extend(feature(first & 0xffff, &instruction[1..]));
        rest = after;
    }
    found
}

/// The features that one instruction uses, by its code and operands.
fn feature(code: u32, operands: &[u32]) -> Option<&'static str> {
    let operand = |i: usize| operands.get(i).copied();
    Some(match code {
        12 => return extended(operand(3)?),
        57 => "function calls",
        59 if operand(2) == Some(STORAGE_WORKGROUP) => "workgroup memory",
        59 if operand(2) == Some(STORAGE_PUSH_CONSTANT) => "push constants",
        68 => "lengths of run-time arrays",
        71 if operand(1) == Some(DECORATION_ARRAY_STRIDE) => match operand(2)? {
            16 => "arrays of 16 bytes an element",
            32.. => "arrays of structures",
            _ => return None,
        },
        72 if operand(2) == Some(35) && operand(3).is_some_and(|offset| offset % 16 != 0) => {
            "members that are not aligned to 16 bytes"
        }
        86..=98 => "reading images",
        99 => "writing images",
        124 => "bitcasts",
        204 | 205 => "reversed and counted bits",
        224 => "barriers of workgroups",
        227..=242 => "atomics",
        246 => "loops",
        251 => "switches",
        333..=336 => "subgroup votes",
        337 | 338 => "subgroup broadcasts",
        339..=344 => "subgroup ballots",
        345..=348 => "subgroup shuffles",
        349..=364 => "subgroup arithmetic",
        _ => return None,
    })
}

/// The same for an instruction of GLSL.std.450.
fn extended(instruction: u32) -> Option<&'static str> {
    Some(match instruction {
        13..=25 => "sines, cosines and their inverses",
        26..=30 => "powers, exponentials and logarithms",
        31 | 32 => "roots",
        50 => "fused multiply-add",
        51..=53 => "exponents of numbers",
        54..=65 => "packed numbers",
        73..=75 => "positions of bits",
        _ => return None,
    })
}
