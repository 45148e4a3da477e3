//! Errors of a depth camera: noise, missing returns, and pixels that hang between two surfaces.

use super::camera::Camera;
use super::observation::View;
use crate::rng::{Rng, normal};
use glamx::Vec3;
use rand::RngExt as _;

/// Difference of a depth image from the truth. Each part is off at zero.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::{Camera, DepthNoise};
/// use lpr_core::rng::{Stream, stream};
///
/// let camera = Camera::looking("down", Vec3::Z, Vec3::NEG_Z, 1.0).with_size(64, 64);
/// let truth = vec![1.0; camera.n_pixels()];
/// let measured = |noise: DepthNoise| {
///     let mut depth = truth.clone();
///     noise.apply(&camera, &mut depth, &mut stream(0, Stream::Noise, 0));
///     depth
/// };
/// assert_eq!(measured(DepthNoise::OFF), truth);
/// let seen = measured(DepthNoise::STRUCTURED_LIGHT);
/// assert!(seen.iter().filter(|depth| depth.is_infinite()).count() > 10, "one of a hundred does not return");
/// assert!(seen.iter().filter(|depth| depth.is_finite()).all(|depth| (depth - 1.0).abs() < 0.01));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation at a depth of 1 m, metres; it grows with the square of the depth, as the
    /// error of a disparity does.
    pub sigma_at_1m: f32,
    /// Cosine of the angle between ray and surface normal below which nothing returns.
    pub min_cosine: f32,
    /// Share of the pixels from which nothing returns for no other reason.
    pub dropout: f32,
    /// Chance that a pixel in front of an edge is somewhere between both surfaces.
    pub edge_bleed: f32,
    /// Difference in depth between neighbours that makes an edge, metres.
    pub edge_jump: f32,
}

impl DepthNoise {
    /// None at all: every depth stays as it is, bit by bit.
    pub const OFF: Self =
        Self { sigma_at_1m: 0.0, min_cosine: 0.0, dropout: 0.0, edge_bleed: 0.0, edge_jump: 0.03 };

    /// A structured-light camera.
    ///
    /// 1.425 mm at 1 m are the random error that Khoshelham and Elberink (Sensors 12, 2012, pages
    /// 1437-1454) give for the first Kinect: 1.425e-5 Z² with lengths in centimetres. The other
    /// numbers are our choice: nothing from 80° on, 1 % of the pixels without a return, two of five
    /// pixels at an edge between both surfaces.
    pub const STRUCTURED_LIGHT: Self = Self {
        sigma_at_1m: 1.425e-3,
        min_cosine: 0.173_648,
        dropout: 0.01,
        edge_bleed: 0.4,
        edge_jump: 0.03,
    };

    /// Makes the true depth image of `camera` (row by row, metres) one that is measured.
    ///
    /// Every pixel takes the same number of draws whatever the settings are, so that changing one
    /// part moves no other.
    pub fn apply(&self, camera: &Camera, depth: &mut [f32], rng: &mut Rng) {
        let truth = depth.to_vec();
        let truth = Truth { camera, depth: &truth };
        for (idx, depth) in depth.iter_mut().enumerate() {
            let draws = Draws::new(rng);
            if depth.is_finite() {
                *depth = self.measured(&truth, idx, &draws);
            }
        }
    }

    fn measured(&self, truth: &Truth<'_>, idx: usize, draws: &Draws) -> f32 {
        if draws.dropout < self.dropout
            || truth.cosine(idx).is_some_and(|cosine| cosine < self.min_cosine)
        {
            return View::NOTHING;
        }
        let near = truth.depth[idx];
        let mixed = match truth.behind(idx) {
            Some(far) if far - near > self.edge_jump && draws.bleed < self.edge_bleed => {
                near + draws.share * (far - near)
            }
            _ => near,
        };
        // No nearer than the camera sees, but for what the truth already is by a rounding.
        (mixed + self.sigma_at_1m * mixed * mixed * draws.normal).max(truth.camera.near.min(near))
    }
}

/// Random numbers of one pixel.
struct Draws {
    normal: f32,
    dropout: f32,
    bleed: f32,
    /// Position of a mixed pixel between the near and the far surface, as a share.
    share: f32,
}

impl Draws {
    fn new(rng: &mut Rng) -> Self {
        Self {
            normal: normal(rng),
            dropout: rng.random(),
            bleed: rng.random(),
            share: rng.random(),
        }
    }
}

/// The depth image before it was measured.
struct Truth<'a> {
    camera: &'a Camera,
    depth: &'a [f32],
}

impl Truth<'_> {
    /// The pixels left and right of a pixel, and those above and below it.
    fn neighbors(&self, idx: usize) -> [[Option<usize>; 2]; 2] {
        let (width, x) = (self.camera.width, idx % self.camera.width);
        let seen = |there: bool, neighbor: usize| {
            (there && self.depth.get(neighbor).is_some_and(|depth| depth.is_finite()))
                .then_some(neighbor)
        };
        [
            [seen(x > 0, idx.wrapping_sub(1)), seen(x + 1 < width, idx + 1)],
            [seen(idx >= width, idx.wrapping_sub(width)), seen(true, idx + width)],
        ]
    }

    /// Depth of the farthest neighbour.
    fn behind(&self, idx: usize) -> Option<f32> {
        self.neighbors(idx)
            .into_iter()
            .flatten()
            .flatten()
            .map(|neighbor| self.depth[neighbor])
            .reduce(f32::max)
    }

    /// The point that a pixel sees, in the frame of the camera.
    fn point(&self, idx: usize) -> Vec3 {
        let Camera { fx, fy, cx, cy, width, .. } = *self.camera;
        let (x, y) = ((idx % width) as f32 + 0.5, (idx / width) as f32 + 0.5);
        Vec3::new((x - cx) / fx, (y - cy) / fy, 1.0) * self.depth[idx]
    }

    /// Cosine of the angle between the ray of a pixel and the surface there; `None` where
    /// neighbours are missing.
    fn cosine(&self, idx: usize) -> Option<f32> {
        // The neighbour that is nearer in depth: the other one may be beyond an edge.
        let jump = |neighbor: usize| (self.depth[neighbor] - self.depth[idx]).abs();
        let point = self.point(idx);
        let [along_row, along_column] = self.neighbors(idx).map(|pair| {
            let nearest =
                pair.into_iter().flatten().min_by(|&a, &b| jump(a).total_cmp(&jump(b)))?;
            Some(self.point(nearest) - point)
        });
        let normal = along_row?.cross(along_column?).try_normalize()?;
        Some(normal.dot(point.try_normalize()?).abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use glamx::Pose3;

    fn camera() -> Camera {
        Camera::at("test", Pose3::IDENTITY, 0.7)
    }

    fn measured(noise: &DepthNoise, truth: &[f32], seed: u64) -> Vec<f32> {
        let mut depth = truth.to_vec();
        noise.apply(&camera(), &mut depth, &mut stream(seed, Stream::Noise, 0));
        depth
    }

    /// A wall across the optical axis.
    fn wall(depth: f32) -> Vec<f32> {
        vec![depth; camera().n_pixels()]
    }

    /// The left half near, the right half far.
    fn step(near: f32, far: f32) -> Vec<f32> {
        let camera = camera();
        (0..camera.n_pixels())
            .map(|idx| if idx % camera.width < camera.width / 2 { near } else { far })
            .collect()
    }

    /// A floor 0.5 m below the optical axis.
    fn floor() -> Vec<f32> {
        let camera = camera();
        let depth = |idx: usize| 0.5 * camera.fy / ((idx / camera.width) as f32 + 0.5 - camera.cy);
        (0..camera.n_pixels())
            .map(|idx| if depth(idx) > 0.0 { depth(idx) } else { View::NOTHING })
            .collect()
    }

    #[test]
    fn off_is_the_truth_bit_for_bit() {
        for truth in [wall(1.3), step(0.7, 2.0), floor()] {
            assert_eq!(measured(&DepthNoise::OFF, &truth, 1), truth);
        }
    }

    #[test]
    fn sigma_grows_with_the_square_of_the_depth() {
        let noise =
            DepthNoise { sigma_at_1m: DepthNoise::STRUCTURED_LIGHT.sigma_at_1m, ..DepthNoise::OFF };
        let sigma = |depth: f32| {
            let errors =
                measured(&noise, &wall(depth), 3).into_iter().map(|z| f64::from(z - depth));
            (errors.map(|error| error * error).sum::<f64>() / camera().n_pixels() as f64).sqrt()
        };
        // Of 16384 draws: the standard error of each is 0.55 %.
        assert!((sigma(1.0) / 1.425e-3 - 1.0).abs() < 0.02, "{}", sigma(1.0));
        assert!((sigma(2.0) / sigma(1.0) - 4.0).abs() < 0.02, "{}", sigma(2.0) / sigma(1.0));
    }

    #[test]
    fn holes_only_remove() {
        let noise = DepthNoise { dropout: 0.0, min_cosine: 0.0, ..DepthNoise::STRUCTURED_LIGHT };
        for truth in [wall(1.0), step(0.8, 1.5), floor()] {
            let whole = measured(&noise, &truth, 4);
            let holed = measured(&DepthNoise::STRUCTURED_LIGHT, &truth, 4);
            let holes = whole
                .iter()
                .zip(&holed)
                .filter(|(whole, holed)| whole != holed)
                .map(|(_, holed)| *holed);
            let holes: Vec<_> = holes.collect();
            assert!(!holes.is_empty() && holes.iter().all(|&depth| depth == View::NOTHING));
        }
    }

    #[test]
    fn the_share_of_missing_returns_is_that_of_the_setting() {
        let noise = DepthNoise { dropout: 0.1, ..DepthNoise::OFF };
        let n_holes =
            measured(&noise, &wall(1.0), 5).iter().filter(|depth| depth.is_infinite()).count();
        // Three standard deviations of a binomial: 115.
        assert!(n_holes.abs_diff(1638) < 115, "{n_holes}");
    }

    #[test]
    fn a_floor_is_missing_from_where_rays_graze_it() {
        let noise = DepthNoise { min_cosine: 0.1, ..DepthNoise::OFF };
        let (camera, truth) = (camera(), floor());
        for (idx, depth) in measured(&noise, &truth, 6)
            .into_iter()
            .enumerate()
            .filter(|(idx, _)| truth[*idx].is_finite())
        {
            let (x, y) = (
                (idx % camera.width) as f32 + 0.5 - camera.cx,
                (idx / camera.width) as f32 + 0.5 - camera.cy,
            );
            let down = y / camera.fy;
            let cosine = down / (1.0 + down * down + (x / camera.fx).powi(2)).sqrt();
            if (cosine - 0.1).abs() > 1e-3 {
                assert_eq!(depth.is_infinite(), cosine < 0.1, "pixel {idx} with cosine {cosine}");
            }
        }
    }

    #[test]
    fn flying_pixels_are_in_front_of_an_edge_and_between_its_surfaces() {
        let noise = DepthNoise { edge_bleed: 1.0, ..DepthNoise::OFF };
        let (camera, truth) = (camera(), step(0.8, 1.5));
        for (idx, (depth, truth)) in measured(&noise, &truth, 7).into_iter().zip(&truth).enumerate()
        {
            let is_at_edge = idx % camera.width == camera.width / 2 - 1;
            assert_eq!(depth != *truth, is_at_edge, "pixel {idx}");
            assert!((0.8..=1.5).contains(&depth));
        }
        let small = DepthNoise { edge_jump: 0.8, ..noise };
        assert_eq!(measured(&small, &truth, 7), truth, "a step of 0.7 m is no edge of 0.8 m");
    }

    #[test]
    fn the_seed_decides() {
        let seen = |seed| measured(&DepthNoise::STRUCTURED_LIGHT, &step(0.8, 1.5), seed);
        assert_eq!(seen(8), seen(8));
        assert_ne!(seen(8), seen(9));
    }
}
