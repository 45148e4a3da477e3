//! A palette of up to 256 colours for one picture or several.
//!
//! The colours of thin lines must survive beside large shaded surfaces: boxes of the colour cube
//! are split where they are wide rather than where most pixels are, which is where a quantiser that
//! learns from samples puts its colours.

/// Most colours of a GIF's palette.
pub(super) const MAX_COLORS: usize = 256;
/// Bits of each channel that tell colours apart.
const BITS: usize = 6;
const LEVELS: usize = 1 << BITS;

/// A palette, and the index of every pixel's colour in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Indexed {
    /// Red, green and blue of one colour after the other.
    pub(super) palette: Vec<u8>,
    pub(super) pixels: Vec<u8>,
}

/// Pixels of nearly one colour.
#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    index: usize,
    sum: [u64; 3],
    n_pixels: u64,
}

impl Bin {
    /// Level of a channel, 0 to [`LEVELS`].
    const fn level(&self, channel: usize) -> usize {
        self.index >> (BITS * channel) & (LEVELS - 1)
    }
}

/// The picture in at most `n_colors` (up to [`MAX_COLORS`]).
pub(super) fn indexed(pixels: &[[u8; 3]], n_colors: usize) -> Indexed {
    let mut bins = vec![Bin::default(); LEVELS * LEVELS * LEVELS];
    for rgb in pixels {
        let bin = &mut bins[bin_of(*rgb)];
        bin.n_pixels += 1;
        for (sum, value) in bin.sum.iter_mut().zip(rgb) {
            *sum += u64::from(*value);
        }
    }
    let mut used: Vec<Bin> = Vec::new();
    for (index, bin) in bins.iter().enumerate().filter(|(_, bin)| bin.n_pixels > 0) {
        used.push(Bin { index, ..*bin });
    }
    let boxes = split(&mut used, n_colors);
    let mut color_of_bin = vec![0_u8; bins.len()];
    let mut palette = Vec::with_capacity(3 * boxes.len());
    for (color, members) in (0_u8..=u8::MAX).zip(&boxes) {
        members.iter().for_each(|bin| color_of_bin[bin.index] = color);
        let n: u64 = members.iter().map(|bin| bin.n_pixels).sum();
        palette.extend([0, 1, 2].map(|c| {
            (members.iter().map(|bin| bin.sum[c]).sum::<u64>() as f64 / n as f64).round() as u8
        }));
    }
    Indexed { palette, pixels: pixels.iter().map(|rgb| color_of_bin[bin_of(*rgb)]).collect() }
}

fn bin_of(rgb: [u8; 3]) -> usize {
    let level = |channel: usize| usize::from(rgb[channel]) >> (8 - BITS);
    level(0) | level(1) << BITS | level(2) << (2 * BITS)
}

/// Parts of `bins`, at most `n_colors`, none empty.
fn split(bins: &mut [Bin], n_colors: usize) -> Vec<&[Bin]> {
    let mut boxes = vec![bins];
    while boxes.len() < n_colors {
        let widest =
            (0..boxes.len()).max_by(|&a, &b| width(boxes[a]).1.total_cmp(&width(boxes[b]).1));
        let Some(widest) = widest.filter(|&idx| width(boxes[idx]).1 > 0.0) else { break };
        let members = boxes.swap_remove(widest);
        let (channel, _) = width(members);
        let (low, high) = range(members, channel);
        members.sort_by_key(|bin| bin.level(channel));
        let (first, second) = members
            .split_at_mut(members.partition_point(|bin| 2 * bin.level(channel) <= low + high));
        boxes.extend([first, second]);
    }
    boxes.into_iter().map(|members| &*members).collect()
}

/// The channel in which a box is widest, and how much it asks to be split there.
fn width(members: &[Bin]) -> (usize, f64) {
    let side = |channel: usize| {
        let (low, high) = range(members, channel);
        high - low
    };
    let channel = (0..3).max_by_key(|&channel| side(channel)).unwrap_or(0);
    let n_pixels: u64 = members.iter().map(|bin| bin.n_pixels).sum();
    // Many pixels count, but a hundredfold only as much as a threefold width.
    (channel, (side(channel) as f64).powi(2) * (n_pixels as f64).sqrt())
}

fn range(members: &[Bin], channel: usize) -> (usize, usize) {
    let levels = members.iter().map(|bin| bin.level(channel));
    levels.fold((LEVELS, 0), |(low, high), level| (low.min(level), high.max(level)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(indexed: &Indexed) -> Vec<[u8; 3]> {
        let color =
            |index: u8| core::array::from_fn(|c| indexed.palette[3 * usize::from(index) + c]);
        indexed.pixels.iter().map(|&index| color(index)).collect()
    }

    #[test]
    fn few_colours_stay_as_they_are() {
        let pixels: Vec<_> = (0..100_u8).map(|idx| [4 * (idx % 10), 8 * (idx / 10), 7]).collect();
        assert_eq!(shown(&indexed(&pixels, MAX_COLORS)), pixels);
        assert_eq!(shown(&indexed(&[[1, 2, 3]; 5], MAX_COLORS)), [[1, 2, 3]; 5]);
    }

    #[test]
    fn a_thin_line_keeps_its_colour_beside_a_large_shaded_surface() {
        let surface = (0..60_000_u32).map(|idx| {
            [(160 + idx % 90) as u8, (150 + idx / 7 % 90) as u8, (140 + idx / 640 % 94) as u8]
        });
        let mut pixels: Vec<_> = surface.collect();
        let yellow = [250, 220, 30];
        pixels.extend([yellow; 40]);
        let shown = shown(&indexed(&pixels, MAX_COLORS));
        let error = |idx: usize| {
            shown[idx].iter().zip(pixels[idx]).map(|(a, b)| a.abs_diff(b)).max().unwrap()
        };
        assert!((60_000..60_040).all(|idx| error(idx) <= 6), "{:?}", shown[60_000]);
        assert!(
            (0..60_000).all(|idx| error(idx) <= 24),
            "{}",
            (0..60_000).map(error).max().unwrap()
        );
    }
}
