//! Blocks of 8 x 8 texels, side by side in the rows of an atlas view. Each is a cluster of shading points.

/// Side of a block.
pub(crate) const BLOCK: u32 = 8;
/// Entries of a block.
pub(crate) const ENTRIES: usize = (BLOCK * BLOCK) as usize;
/// Most blocks in a row of a view.
pub(crate) const ACROSS: usize = 64;

/// Width and height of a view of so many blocks.
pub(crate) fn view_size(blocks: usize) -> [u32; 2] {
    let across = ACROSS.min(blocks).max(1);
    [across as u32 * BLOCK, blocks.div_ceil(across) as u32 * BLOCK]
}

/// Index, in a view of this width, of entry `i` of block `block`, both row by row.
pub(crate) fn slot(block: usize, i: usize, width: u32) -> usize {
    let (side, width) = (BLOCK as usize, width as usize);
    let across = width / side;
    let (x, y) = (block % across * side + i % side, block / across * side + i / side);
    x + y * width
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_fill_their_view() {
        for blocks in [1, 2, 64, 65, 130] {
            let [width, height] = view_size(blocks);
            let mut slots: Vec<usize> = (0..blocks * ENTRIES).map(|k| slot(k / ENTRIES, k % ENTRIES, width)).collect();
            slots.sort_unstable();
            slots.dedup();
            assert_eq!(slots.len(), blocks * ENTRIES);
            assert!(slots[slots.len() - 1] < (width * height) as usize, "{blocks}");
            assert!((width * height) as usize - slots.len() < ACROSS * ENTRIES, "{blocks}");
        }
        assert_eq!((view_size(65), slot(64, 9, 512)), ([512, 16], 8 * 512 + 512 + 1));
    }
}
