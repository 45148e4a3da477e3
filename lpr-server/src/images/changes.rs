//! An animation that is small: one palette for all of it, and of each picture only what has
//! changed.

use super::palette::{self, MAX_COLORS};
use super::{Shown, check_frames, delay, gif_to_io};
use crate::files::{self, Result};
use std::path::Path;

/// The index that leaves a pixel as it was; the colours have those below.
const UNCHANGED: u8 = u8::MAX;

/// The part of a picture that differs from the one before it.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Change {
    left: u16,
    top: u16,
    width: u16,
    height: u16,
    /// Colours in the palette, [`UNCHANGED`] between them.
    pixels: Vec<u8>,
}

/// Writes an endless animation, atomically, with 255 colours for all its pictures: a still camera's
/// takes a fraction of what [`super::write_gif`] needs.
///
/// # Errors
///
/// When there is no frame, one has not `width * height` pixels, or the file cannot be written.
pub fn write_gif_of_changes(path: &Path, width: u16, height: u16, frames: &[Shown]) -> Result<()> {
    check_frames(path, width, height, frames)?;
    let all: Vec<_> = frames.iter().flat_map(|frame| frame.pixels.iter().copied()).collect();
    let indexed = palette::indexed(&all, MAX_COLORS - 1);
    let pictures: Vec<_> =
        indexed.pixels.chunks(usize::from(width) * usize::from(height)).collect();
    files::write_atomically(path, |writer| {
        let mut encoder =
            gif::Encoder::new(writer, width, height, &indexed.palette).map_err(gif_to_io)?;
        encoder.set_repeat(gif::Repeat::Infinite).map_err(gif_to_io)?;
        for (idx, shown) in frames.iter().enumerate() {
            let before = idx.checked_sub(1).map(|before| pictures[before]);
            let Change { left, top, width, height, pixels } =
                change(before, pictures[idx], usize::from(width));
            let frame = gif::Frame {
                left,
                top,
                width,
                height,
                delay: delay(shown.millis),
                transparent: Some(UNCHANGED),
                dispose: gif::DisposalMethod::Keep,
                buffer: pixels.into(),
                ..gif::Frame::default()
            };
            encoder.write_frame(&frame).map_err(gif_to_io)?;
        }
        Ok(())
    })
}

/// The change from `before` to `after`; all of `after` where there is nothing before it.
fn change(before: Option<&[u8]>, after: &[u8], width: usize) -> Change {
    let differs = |idx: usize| before.is_none_or(|before| before[idx] != after[idx]);
    let changed: Vec<_> = (0..after.len())
        .filter(|&idx| differs(idx))
        .map(|idx| [idx % width, idx / width])
        .collect();
    // A frame of no size is not allowed: where nothing changes, its first pixel stands for all.
    let range = |axis: usize| {
        let places = || changed.iter().map(move |place| place[axis]);
        (places().min().unwrap_or(0), places().max().unwrap_or(0))
    };
    let ((left, right), (top, bottom)) = (range(0), range(1));
    let row = |y: usize| (left..=right).map(move |x| y * width + x);
    let pixels = (top..=bottom)
        .flat_map(row)
        .map(|idx| if differs(idx) { after[idx] } else { UNCHANGED })
        .collect();
    let [left, top, width, height] =
        [left, top, right - left + 1, bottom - top + 1].map(|side| side as u16);
    Change { left, top, width, height, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;

    /// A bright square on a shaded ground that moves with every frame, and stays for the last.
    fn frames() -> Vec<Shown> {
        let pixel = |at: usize, x: usize, y: usize| {
            let inside = (at..at + 4).contains(&x) && (3..7).contains(&y);
            if inside { [250, 220, 30] } else { [(40 + 2 * x) as u8, (60 + 3 * y) as u8, 90] }
        };
        let picture = |at: usize| (0..20 * 12).map(|idx| pixel(at, idx % 20, idx / 20)).collect();
        [0, 3, 9, 9].map(|at| Shown { pixels: picture(at), millis: 200 }).to_vec()
    }

    /// The pictures of an animation as a viewer puts them together.
    fn pictures(path: &Path) -> Vec<Vec<[u8; 3]>> {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(File::open(path).unwrap()).unwrap();
        let width = usize::from(decoder.width());
        let mut shown = vec![[0; 3]; width * usize::from(decoder.height())];
        let mut pictures = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (idx, pixel) in frame.buffer.chunks(4).enumerate() {
                let (x, y) = (idx % usize::from(frame.width), idx / usize::from(frame.width));
                let place = (usize::from(frame.top) + y) * width + usize::from(frame.left) + x;
                if pixel[3] > 0 {
                    shown[place] = [pixel[0], pixel[1], pixel[2]];
                }
            }
            pictures.push(shown.clone());
        }
        pictures
    }

    #[test]
    fn a_viewer_sees_every_picture_as_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.gif");
        let frames = frames();
        write_gif_of_changes(&path, 20, 12, &frames).unwrap();
        let shown = pictures(&path);
        assert_eq!(shown.len(), frames.len());
        for (shown, frame) in
            shown.iter().flatten().zip(frames.iter().flat_map(|frame| &frame.pixels))
        {
            let error = shown.iter().zip(frame).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(error <= Some(4), "{shown:?} for {frame:?}");
        }
    }

    #[test]
    fn only_what_changes_is_written() {
        let before = [1, 1, 1, 1, 2, 1, 1, 1, 1];
        let after = [1, 1, 1, 1, 3, 1, 1, 4, 1];
        let expected = Change { left: 1, top: 1, width: 1, height: 2, pixels: vec![3, 4] };
        assert_eq!(change(Some(&before), &after, 3), expected);
        assert_eq!(change(None, &after, 3).pixels, after);
        let nothing = Change { left: 0, top: 0, width: 1, height: 1, pixels: vec![UNCHANGED] };
        assert_eq!(change(Some(&after), &after, 3), nothing);
    }

    #[test]
    fn an_animation_without_frames_or_of_another_size_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.gif");
        assert!(write_gif_of_changes(&path, 20, 12, &[]).is_err());
        assert!(write_gif_of_changes(&path, 20, 13, &frames()).is_err());
        assert!(!path.exists());
    }
}
