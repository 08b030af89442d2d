//! Words of a task's pixels in further arrays ([`Frame::more_buffers`](crate::frame::Frame::more_buffers)) in bytes: as they are, word by word, where they matter.

use super::columns::{get, put};
use super::{CAUSTICS, OF_REFLECTORS, Shape};

/// The words of one array.
pub(super) struct Array {
    /// Its number.
    pub(super) array: usize,
    /// Pixels of the task that have some; `None`: all have. The others have zeros.
    pub(super) which: Option<Vec<u32>>,
    /// Their words, the first of all of them first.
    pub(super) columns: Vec<Vec<u32>>,
}

/// Words in further arrays, of those that there are.
pub(super) struct More(Vec<Array>);

/// Whether the words of a pixel matter in an array, by what the reflectors' array has of it.
fn matters(array: usize, region: Option<u32>) -> bool {
    !OF_REFLECTORS.contains(&array) || region.is_some_and(|region| region != 0)
}

/// Appends the words of `pixels` pixels, of caustics first the pixels that have any. `more`: array by array, words of a pixel together.
pub(super) fn put_more(out: &mut Vec<u8>, shape: &Shape, more: &[u32], pixels: usize) {
    let regions = &more[..shape.more[0] * pixels];
    let mut begin = 0;
    for (array, words) in shape.more.into_iter().enumerate() {
        let of = |i: usize, word: usize| more[begin + words * i + word];
        let mut which: Vec<usize> = (0..pixels).filter(|&i| matters(array, regions.get(i).copied())).collect();
        if CAUSTICS.contains(&array) && words > 0 {
            let is_lit = |&i: &usize| (0..words).any(|word| of(i, word) != 0);
            put::<1>(out, &which.iter().map(|i| u32::from(is_lit(i))).collect::<Vec<_>>());
            which.retain(is_lit);
        }
        for word in 0..words {
            put::<4>(out, &which.iter().map(|&i| of(i, word)).collect::<Vec<_>>());
        }
        begin += words * pixels;
    }
}

impl More {
    /// Takes the words that [`put_more`] appended from the front of `bytes`; `None`: `bytes` ends before them.
    pub(super) fn get(bytes: &mut &[u8], shape: &Shape, pixels: usize) -> Option<More> {
        let mut arrays: Vec<Array> = Vec::new();
        for (array, words) in shape.more.into_iter().enumerate().filter(|(_, words)| *words > 0) {
            let of = |has: &dyn Fn(usize) -> bool| (0..pixels as u32).filter(|&i| has(i as usize)).collect::<Vec<_>>();
            let which = if OF_REFLECTORS.contains(&array) {
                let regions = arrays.iter().find(|array| array.array == 0).map(|array| &array.columns[0]);
                Some(of(&|i| matters(array, regions.map(|regions| regions[i]))))
            } else if CAUSTICS.contains(&array) {
                let lit = get::<u8, 1>(bytes, pixels)?;
                Some(of(&|i| lit[i] != 0))
            } else {
                None
            };
            let count = which.as_ref().map_or(pixels, Vec::len);
            let columns = (0..words).map(|_| get::<u32, 4>(bytes, count)).collect::<Option<_>>()?;
            arrays.push(Array { array, which, columns });
        }
        Some(More(arrays))
    }

    /// The arrays in order.
    pub(super) fn arrays(&self) -> &[Array] {
        &self.0
    }

    /// All words of `pixels` pixels, as [`put_more`] takes them.
    pub(super) fn all(&self, shape: &Shape, pixels: usize) -> Vec<u32> {
        let mut all = vec![0; shape.words() * pixels];
        let mut begin = 0;
        for Array { which, columns, .. } in &self.0 {
            let words = columns.len();
            for (word, column) in columns.iter().enumerate() {
                for (k, &value) in column.iter().enumerate() {
                    let i = which.as_ref().map_or(k, |which| which[k] as usize);
                    all[begin + words * i + word] = value;
                }
            }
            begin += words * pixels;
        }
        all
    }
}
