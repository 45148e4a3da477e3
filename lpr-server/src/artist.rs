//! Pictures of worlds from one camera, with lines and words.

use lpr_core::Result;
use lpr_core::glamx::{Pose3, Vec3};
use lpr_core::path::JointPath;
use lpr_core::perception::Camera;
use lpr_core::robot::Robot;
use lpr_core::sim::render::{Picture, Renderer, Stroke};
use lpr_core::sim::{SimEnvironment, World};

/// The camera that stands where a visitor would, and is no camera of an agent.
pub const BEAUTY: &str = "beauty";
/// Places of visitors, from the workspace's centre along x and y: before the arm, behind it, and on
/// its other side.
const VIEWS: [(&str, [f32; 2]); 3] =
    [(BEAUTY, [1.03, 1.25]), ("beauty_behind", [-1.03, 1.25]), ("beauty_beside", [1.03, -1.25])];
/// Samples per pixel along each side.
const SAMPLES: usize = 3;
/// Rows of a picture for each pixel of a line's width, and of a letter's dots.
const ROWS_PER_DOT: f32 = 240.0;
/// Rows from one line of text to the next, in a letter's dots.
const ROWS_PER_TEXT: i32 = 10;
/// Distance of text from the edge, in a letter's dots.
const MARGIN: i32 = 6;

/// Size of a picture, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

/// A line over a picture, as the grip's way along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    points: Vec<Vec3>,
    rgb: [u8; 3],
    /// Relative to that of other lines.
    width: f32,
}

impl Line {
    /// The way of the grip along `path`.
    #[must_use]
    pub fn of(robot: &Robot, path: &JointPath, rgb: [u8; 3], width: f32) -> Self {
        /// Close enough to look curved where the arm's joints make a curve.
        const N_POINTS: usize = 120;
        let n_points = N_POINTS.max(path.configs().len());
        let points = path
            .subdivide(n_points)
            .configs()
            .iter()
            .map(|config| robot.grip(config).translation)
            .collect();
        Self { points, rgb, width }
    }

    /// A line through `points`, metres in the world.
    #[must_use]
    pub const fn through(points: Vec<Vec3>, rgb: [u8; 3], width: f32) -> Self {
        Self { points, rgb, width }
    }

    /// The same way in another colour and width.
    #[must_use]
    pub fn restyled(&self, rgb: [u8; 3], width: f32) -> Self {
        Self { points: self.points.clone(), rgb, width }
    }
}

/// Draws worlds from one camera.
#[derive(Debug)]
pub struct Artist<'a> {
    renderer: Renderer,
    camera: &'a str,
    size: Size,
    samples: usize,
}

impl<'a> Artist<'a> {
    /// For pictures from `camera`: a built-in one, [`BEAUTY`] or what [`view_of`] says.
    #[must_use]
    pub fn new(camera: &'a str, size: Size) -> Self {
        Self { renderer: Renderer::for_pictures(), camera, size, samples: SAMPLES }
    }

    /// For pictures that have to be quick: fewer samples for each pixel.
    #[must_use]
    pub fn quick(camera: &'a str, size: Size) -> Self {
        Self { samples: SAMPLES - 1, ..Self::new(camera, size) }
    }

    /// The world with lines over it, the last on top.
    ///
    /// # Errors
    ///
    /// When the camera is unknown, or a shape of the scene has no volume.
    pub fn draw(&mut self, world: &World, lines: &[Line]) -> Result<Picture> {
        let items = SimEnvironment::picture_items(world, &mut self.renderer)?;
        let camera = self.camera(world)?;
        let mut picture = self.renderer.render_picture(&camera, &items, self.samples);
        for Line { points, rgb, width } in lines {
            let stroke = Stroke { rgb: *rgb, width: width * self.dot(), hidden_opacity: 0.3 };
            picture.draw_polyline(&camera, points, &stroke);
        }
        Ok(picture)
    }

    /// Writes lines of text one below the other from the top left corner on; the row below them.
    pub fn write(&self, picture: &mut Picture, lines: &[(String, [u8; 3])]) -> i32 {
        let scale = self.scale();
        for (row, (text, rgb)) in (0..).zip(lines) {
            picture.draw_text(
                [MARGIN * scale, (MARGIN + ROWS_PER_TEXT * row) * scale],
                text,
                *rgb,
                scale as usize,
            );
        }
        (MARGIN + ROWS_PER_TEXT * lines.len() as i32) * scale
    }

    /// Draws a bar at row `top` whose colours go from `color(0)` on the left to `color(1)`.
    pub fn draw_bar(&self, picture: &mut Picture, top: i32, color: impl Fn(f32) -> [u8; 3]) {
        /// Columns and rows of the bar, in a letter's dots.
        const BAR: [usize; 2] = [60, 5];
        let scale = self.scale() as usize;
        let [n_columns, n_rows] = BAR.map(|dots| dots * scale);
        let (left, top) = (MARGIN as usize * scale, usize::try_from(top).unwrap_or(0));
        for row in top..(top + n_rows).min(picture.height) {
            for column in 0..n_columns.min(picture.width.saturating_sub(left)) {
                picture.rgb[row * picture.width + left + column] =
                    color(column as f32 / (n_columns - 1) as f32);
            }
        }
    }

    /// Pixels of a letter's dot.
    fn scale(&self) -> i32 {
        self.dot() as i32
    }

    /// Width of a line, pixels.
    fn dot(&self) -> f32 {
        (f32::from(self.size.height) / ROWS_PER_DOT).max(1.0)
    }

    fn camera(&self, world: &World) -> Result<Camera> {
        let robot = world.robot();
        let world_from_flange = Pose3::from(robot.flange(world.config()));
        let camera = match VIEWS.into_iter().find(|(name, _)| *name == self.camera) {
            Some((name, at)) => beauty(name, at, robot)?,
            None => Camera::by_name(self.camera, robot, &world_from_flange)?,
        };
        Ok(camera.with_size(self.size.width.into(), self.size.height.into()))
    }
}

/// The first of the visitors' cameras that looks at what a hand approaches along `approach`, and
/// not at its back.
#[must_use]
pub fn view_of(approach: Vec3) -> &'static str {
    /// Cosine of the angle between approach and view, times the view's length, from which the back
    /// is seen.
    const BACK: f32 = 0.3;
    let shows_the_front = |[x, y]: [f32; 2]| x * approach.x + y * approach.y < BACK;
    VIEWS.into_iter().find(|(_, at)| shows_the_front(*at)).map_or(BEAUTY, |(name, _)| name)
}

/// A view over the whole arm and the workspace from one side: of a larger arm from farther away.
fn beauty(name: &str, [x, y]: [f32; 2], robot: &Robot) -> Result<Camera> {
    /// Distance of the workspace's centre from the base for which the numbers below are, metres:
    /// the xArm7's.
    const REACH: f32 = 0.38;
    let center = robot.workspace_center()?.extend(0.0);
    // Half of it: a larger arm may fill more of the picture.
    let scale = 0.5 + 0.5 * center.x / REACH;
    let position = center + scale * Vec3::new(x, y, 0.95);
    let target = center + scale * Vec3::new(-0.17, 0.0, 0.31);
    Ok(Camera::looking_at(name, position, target, 37_f32.to_radians()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn visitors_stand_where_they_see_what_the_hand_approaches() {
        for (approach, view) in [
            (Vec3::NEG_Z, BEAUTY),
            (Vec3::NEG_Y, BEAUTY),
            (Vec3::X, "beauty_behind"),
            (Vec3::new(0.5, 0.0, -0.9), "beauty_behind"),
            (Vec3::Y, "beauty_beside"),
        ] {
            assert_eq!(view_of(approach), view, "{approach}");
        }
    }
}
