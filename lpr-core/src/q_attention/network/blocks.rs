//! Cells of a cubic grid in block order: every aligned 2³ block of cells is contiguous, on the grid
//! itself and on the grid of half its side, so that going to a grid of half the side and back is a
//! reshape.

/// Place in block order of all cells of a `side`³ grid in raster order (x fastest), where aligned
/// blocks of `block`³ cells (1, 2 or 4) follow each other in raster order and the cells of a block
/// stand in Morton order.
pub(super) fn block_of_raster(side: usize, block: usize) -> Vec<usize> {
    assert!(
        matches!(block, 1 | 2 | 4) && side.is_multiple_of(block),
        "a side of {side} has no blocks of {block}"
    );
    let n_blocks = side / block;
    let mut order = Vec::with_capacity(side * side * side);
    for z in 0..side {
        for y in 0..side {
            for x in 0..side {
                let outer = (z / block * n_blocks + y / block) * n_blocks + x / block;
                order.push(
                    outer * block * block * block + morton([x % block, y % block, z % block]),
                );
            }
        }
    }
    order
}

/// The inverse: raster index of each cell in block order.
pub(super) fn raster_of_block(side: usize, block: usize) -> Vec<usize> {
    let forward = block_of_raster(side, block);
    let mut raster = vec![0; forward.len()];
    for (raster_idx, &block_idx) in forward.iter().enumerate() {
        raster[block_idx] = raster_idx;
    }
    raster
}

/// Interleaves the two lowest bits of `x`, `y` and `z`, those of `x` first.
fn morton(xyz: [usize; 3]) -> usize {
    let spread = |value: usize| value & 1 | (value & 2) << 2;
    spread(xyz[0]) | spread(xyz[1]) << 1 | spread(xyz[2]) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_successive_cells_are_a_block_at_both_scales() {
        for side in [8, 12] {
            let cell =
                |raster: &usize| [raster % side, raster / side % side, raster / (side * side)];
            let half = raster_of_block(side / 2, 2);
            for (block_idx, block) in raster_of_block(side, 4).chunks(8).enumerate() {
                let coarse = half[block_idx];
                let parent = [
                    coarse % (side / 2),
                    coarse / (side / 2) % (side / 2),
                    coarse / (side * side / 4),
                ];
                assert!(block.iter().map(cell).all(|xyz| xyz.map(|i| i / 2) == parent));
            }
        }
    }
}
