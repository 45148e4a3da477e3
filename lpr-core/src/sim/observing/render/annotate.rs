//! Lines and words in pictures.

use super::font::{GLYPH_HEIGHT, GLYPH_WIDTH, glyph};
use super::picture::Picture;
use crate::perception::Camera;
use glamx::{Vec2, Vec3};

/// Greatest depth by which a line may lie behind what a pixel shows and still count as on it,
/// metres.
const DEPTH_TOLERANCE: f32 = 0.004;
/// Columns from one character to the next, in the font's dots.
const ADVANCE: usize = GLYPH_WIDTH + 1;

/// Style of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// Colour, sRGB.
    pub rgb: [u8; 3],
    /// Width, pixels.
    pub width: f32,
    /// Opacity of the parts behind other things, 0 (hidden) to 1.
    pub hidden_opacity: f32,
}

/// Ends of a line's piece in the image: coordinates and inverse depths.
#[derive(Debug, Clone, Copy)]
struct Piece {
    from: Vec2,
    to: Vec2,
    inverse_depths: [f32; 2],
}

impl Picture {
    /// Draws the line through `points` (in the world) as `camera` sees it: the camera that the
    /// picture was made with.
    pub fn draw_polyline(&mut self, camera: &Camera, points: &[Vec3], stroke: &Stroke) {
        let pieces: Vec<_> =
            points.windows(2).filter_map(|ends| Piece::new(camera, ends[0], ends[1])).collect();
        let Some([low, high]) = self.covered(&pieces, 0.5 * stroke.width + 1.0) else { return };
        // Opacity per pixel first: pieces that overlap at a corner must not darken it twice.
        let width = high[0] - low[0];
        let mut opacity = vec![0.0_f32; width * (high[1] - low[1])];
        for piece in &pieces {
            let Some([start, end]) = self.covered(&[*piece], 0.5 * stroke.width + 1.0) else {
                continue;
            };
            for y in start[1]..end[1] {
                for x in start[0]..end[0] {
                    let pixel = &mut opacity[(y - low[1]) * width + x - low[0]];
                    *pixel = pixel.max(self.opacity_of(piece, stroke, x, y));
                }
            }
        }
        for (idx, &opacity) in opacity.iter().enumerate().filter(|(_, opacity)| **opacity > 0.0) {
            self.blend(low[0] + idx % width, low[1] + idx / width, stroke.rgb, opacity);
        }
    }

    /// Writes `text` (printable ASCII; other characters become '?') with its top left corner at
    /// column `x`, row `y`.
    ///
    /// A character is `5 scale` wide and `7 scale` high; parts outside the picture are cut off.
    pub fn draw_text(&mut self, [x, y]: [i32; 2], text: &str, rgb: [u8; 3], scale: usize) {
        for (position, character) in text.chars().enumerate() {
            for (row, bits) in glyph(character).into_iter().enumerate() {
                for column in
                    (0..GLYPH_WIDTH).filter(|column| bits >> (GLYPH_WIDTH - 1 - column) & 1 == 1)
                {
                    let left = x + ((position * ADVANCE + column) * scale) as i32;
                    self.fill_square([left, y + (row * scale) as i32], scale, rgb);
                }
            }
        }
    }

    /// Width and height in pixels that `text` takes at `scale`.
    #[must_use]
    pub fn text_size(text: &str, scale: usize) -> [usize; 2] {
        let n_characters = text.chars().count();
        [(n_characters * ADVANCE).saturating_sub(1) * scale, GLYPH_HEIGHT * scale]
    }

    /// First and end columns and rows within the picture that are at most `margin` pixels from the
    /// pieces.
    fn covered(&self, pieces: &[Piece], margin: f32) -> Option<[[usize; 2]; 2]> {
        let first = pieces.first()?;
        let ends = pieces.iter().flat_map(|piece| [piece.from, piece.to]);
        let (low, high) =
            ends.fold((first.from, first.from), |(low, high), end| (low.min(end), high.max(end)));
        // Casts saturate at zero.
        let (low, high) = (low - margin, high + margin + 1.0);
        let low = [low.x as usize, low.y as usize];
        let high = [(high.x as usize).min(self.width), (high.y as usize).min(self.height)];
        (low[0] < high[0] && low[1] < high[1]).then_some([low, high])
    }

    /// Opacity that `piece` has at a pixel: its coverage, less where something is in front.
    fn opacity_of(&self, piece: &Piece, stroke: &Stroke, x: usize, y: usize) -> f32 {
        let (distance, inverse_depth) = piece.nearest(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        let coverage = (0.5 * stroke.width + 0.5 - distance).clamp(0.0, 1.0);
        let hidden = 1.0 / inverse_depth > self.depth[y * self.width + x] + DEPTH_TOLERANCE;
        if hidden { coverage * stroke.hidden_opacity } else { coverage }
    }

    fn blend(&mut self, x: usize, y: usize, rgb: [u8; 3], opacity: f32) {
        let pixel = &mut self.rgb[y * self.width + x];
        for (old, new) in pixel.iter_mut().zip(rgb) {
            *old = (f32::from(*old) + (f32::from(new) - f32::from(*old)) * opacity + 0.5) as u8;
        }
    }

    fn fill_square(&mut self, [x, y]: [i32; 2], side: usize, rgb: [u8; 3]) {
        let clipped = |start: i32, limit: usize| {
            let inside = |value: i32| usize::try_from(value).unwrap_or(0).min(limit);
            inside(start)..inside(start.saturating_add(side as i32))
        };
        for row in clipped(y, self.height) {
            for column in clipped(x, self.width) {
                self.rgb[row * self.width + column] = rgb;
            }
        }
    }
}

impl Piece {
    /// The part of a line between two points of the world that is in front of the camera.
    fn new(camera: &Camera, from: Vec3, to: Vec3) -> Option<Self> {
        let depth = |point: Vec3| camera.world_from_camera.inverse_transform_point(point).z;
        let (from_depth, to_depth) = (depth(from), depth(to));
        // A margin, since the cut point may round to just behind the near plane.
        let near = camera.near * 1.01;
        if from_depth < near && to_depth < near || !(from.is_finite() && to.is_finite()) {
            return None;
        }
        let cut = || from.lerp(to, (near - from_depth) / (to_depth - from_depth));
        let (from_image, from_depth) =
            camera.project(if from_depth < near { cut() } else { from })?;
        let (to_image, to_depth) = camera.project(if to_depth < near { cut() } else { to })?;
        Some(Self {
            from: from_image,
            to: to_image,
            inverse_depths: [1.0 / from_depth, 1.0 / to_depth],
        })
    }

    /// Distance of `image` from the piece (pixels) and the inverse depth of the piece there.
    fn nearest(&self, image: Vec2) -> (f32, f32) {
        let along = self.to - self.from;
        let length_squared = along.length_squared();
        let fraction = if length_squared > 0.0 {
            ((image - self.from).dot(along) / length_squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let [from, to] = self.inverse_depths;
        ((self.from + along * fraction - image).length(), from + (to - from) * fraction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::View;

    fn blank(camera: &Camera, depth: f32) -> Picture {
        let n = camera.n_pixels();
        Picture {
            width: camera.width,
            height: camera.height,
            rgb: vec![[0; 3]; n],
            depth: vec![depth; n],
        }
    }

    fn camera() -> Camera {
        Camera::looking("x", Vec3::ZERO, Vec3::X, 1.0)
    }

    const STROKE: Stroke = Stroke { rgb: [255; 3], width: 2.0, hidden_opacity: 0.25 };

    #[test]
    fn lines_are_drawn_before_and_faint_behind_what_is_there() {
        let line = [Vec3::new(1.0, -0.3, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 0.3, 0.0)];
        for (depth, brightest) in [(View::NOTHING, 255), (1.1, 255), (0.9, 64)] {
            let mut picture = blank(&camera(), depth);
            picture.draw_polyline(&camera(), &line, &STROKE);
            let drawn = picture.rgb.iter().map(|rgb| rgb[0]).max();
            assert_eq!(drawn, Some(brightest), "at depth {depth}");
        }
    }

    #[test]
    fn lines_from_behind_the_camera_are_cut_and_those_beside_it_left_out() {
        let mut picture = blank(&camera(), View::NOTHING);
        picture.draw_polyline(
            &camera(),
            &[Vec3::new(-1.0, 0.1, 0.0), Vec3::new(2.0, 0.1, 0.0)],
            &STROKE,
        );
        assert!(picture.rgb.iter().any(|rgb| rgb[0] > 0));
        let mut picture = blank(&camera(), View::NOTHING);
        picture.draw_polyline(
            &camera(),
            &[Vec3::new(1.0, 5.0, 0.0), Vec3::new(1.0, 6.0, 0.0)],
            &STROKE,
        );
        picture.draw_polyline(
            &camera(),
            &[Vec3::new(-1.0, 0.0, 0.0), Vec3::new(-2.0, 0.0, 0.0)],
            &STROKE,
        );
        picture.draw_polyline(&camera(), &[Vec3::NAN, Vec3::X], &STROKE);
        picture.draw_polyline(&camera(), &[], &STROKE);
        assert!(picture.rgb.iter().all(|rgb| rgb[0] == 0));
    }

    #[test]
    fn text_takes_the_room_it_says_and_is_cut_at_the_edges() {
        let mut picture = blank(&camera(), View::NOTHING);
        picture.draw_text([3, 4], "LPR", [255; 3], 2);
        let [width, height] = Picture::text_size("LPR", 2);
        let drawn: Vec<_> = (0..picture.rgb.len()).filter(|&idx| picture.rgb[idx][0] > 0).collect();
        let columns = drawn.iter().map(|idx| idx % picture.width);
        assert_eq!(columns.clone().min(), Some(3));
        assert_eq!(columns.max(), Some(3 + width - 1));
        assert_eq!(drawn.iter().map(|idx| idx / picture.width).max(), Some(4 + height - 1));
        picture.draw_text([-5, -5], "edge", [255; 3], 3);
        picture.draw_text([120, 124], "edge", [255; 3], 3);
    }
}
