//! PNG and animated GIF files. Pixels are rows from the top, each from the left.

mod changes;
mod palette;

pub use changes::write_gif_of_changes;

use crate::files::{self, FileError, Result};
use palette::{Indexed, MAX_COLORS};
use std::io;
use std::path::Path;

/// Writes an RGB PNG, atomically.
///
/// # Errors
///
/// When there are not `width * height` pixels or the file cannot be written.
pub fn write_png(path: &Path, width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<()> {
    check_size(path, width, height, pixels)?;
    files::write_atomically(path, |writer| {
        let mut encoder = png::Encoder::new(writer, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(png_to_io)?;
        writer.write_image_data(pixels.as_flattened()).map_err(png_to_io)?;
        writer.finish().map_err(png_to_io)
    })
}

/// A picture of an animation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    /// Its pixels.
    pub pixels: Vec<[u8; 3]>,
    /// Time that it is shown, milliseconds.
    pub millis: u32,
}

/// Writes an endless animation, atomically; each frame has its own palette of 256 colours.
///
/// # Errors
///
/// When there is no frame, one has not `width * height` pixels, or the file cannot be written.
pub fn write_gif(path: &Path, width: u16, height: u16, frames: &[Shown]) -> Result<()> {
    check_frames(path, width, height, frames)?;
    files::write_atomically(path, |writer| {
        let mut encoder = gif::Encoder::new(writer, width, height, &[]).map_err(gif_to_io)?;
        encoder.set_repeat(gif::Repeat::Infinite).map_err(gif_to_io)?;
        for Shown { pixels, millis } in frames {
            let Indexed { palette, pixels } = palette::indexed(pixels, MAX_COLORS);
            let mut frame = gif::Frame::from_palette_pixels(width, height, pixels, palette, None);
            frame.delay = delay(*millis);
            encoder.write_frame(&frame).map_err(gif_to_io)?;
        }
        Ok(())
    })
}

/// The delay in the format's unit, hundredths of a second.
fn delay(millis: u32) -> u16 {
    u16::try_from(millis / 10).unwrap_or(u16::MAX)
}

fn check_frames(path: &Path, width: u16, height: u16, frames: &[Shown]) -> Result<()> {
    if frames.is_empty() {
        return Err(FileError::content(path, "an animation needs at least one frame"));
    }
    frames.iter().try_for_each(|frame| check_size(path, width.into(), height.into(), &frame.pixels))
}

fn check_size(path: &Path, width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<()> {
    if pixels.is_empty() || pixels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(FileError::content(
            path,
            format!("{} pixels are no picture of {width} × {height}", pixels.len()),
        ));
    }
    Ok(())
}

/// Keeps the operating system's reason, such as a full disk.
fn png_to_io(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        error => io::Error::other(error),
    }
}

fn gif_to_io(error: gif::EncodingError) -> io::Error {
    match error {
        gif::EncodingError::Io(error) => error,
        error => io::Error::other(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::BufReader;

    /// Fewer than 256 colours, so that a palette holds them all.
    fn gradient(width: u32, height: u32) -> Vec<[u8; 3]> {
        (0..width * height)
            .map(|idx| [(idx % width) as u8 * 16, (idx / width) as u8 * 16, 7])
            .collect()
    }

    #[test]
    fn a_png_reads_back_as_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let image = gradient(16, 5);
        write_png(&path, 16, 5, &image).unwrap();
        let mut reader =
            png::Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, info.color_type), (16, 5, png::ColorType::Rgb));
        assert_eq!(pixels, image.as_flattened());
    }

    #[test]
    fn a_gif_has_its_frames_delay_and_colours() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.gif");
        let frames =
            [(vec![[10, 20, 200]; 32], 50), (vec![[10, 20, 200]; 32], 1500), (gradient(8, 4), 50)];
        write_gif(&path, 8, 4, &frames.map(|(pixels, millis)| Shown { pixels, millis })).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(BufReader::new(File::open(&path).unwrap())).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (8, 4));
        let mut delays = Vec::new();
        let mut last = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            delays.push(frame.delay);
            last = frame.buffer.to_vec();
        }
        assert_eq!(delays, [5, 150, 5]);
        for (shown, drawn) in last.chunks(4).zip(gradient(8, 4)) {
            let error = shown.iter().zip(drawn).map(|(a, b)| a.abs_diff(b)).max();
            assert!(error <= Some(4), "{shown:?} for {drawn:?}");
        }
    }

    #[test]
    fn a_picture_of_another_size_is_refused_and_leaves_no_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.gif");
        assert!(write_gif(&path, 8, 4, &[]).is_err());
        let frames = [gradient(8, 4), gradient(8, 5)].map(|pixels| Shown { pixels, millis: 50 });
        assert!(write_gif(&path, 8, 4, &frames).is_err());
        assert!(write_png(&path, 0, 4, &[]).is_err());
        assert!(write_png(&path, 8, 5, &gradient(8, 4)).is_err());
        assert!(!path.exists());
    }
}
