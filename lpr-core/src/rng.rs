//! The only place that makes a random generator: one seed, named streams, one generator per use.
//!
//! A generator is a pure function of `(seed, stream, index)`: the index is the episode, environment
//! step or update it serves. So a checkpoint stores counters and no generator state, and a draw
//! added to one stream moves no other.

use rand::{RngExt as _, SeedableRng as _};

/// The generator of every stream: ChaCha with 8 rounds, portable across machines and to wasm.
pub type Rng = rand::rngs::ChaCha8Rng;

/// Purpose of a generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Stream {
    /// Places of a task's objects.
    Placement = 1,
    /// Colours of objects and distractors.
    Colour,
    /// Sensor and camera noise.
    Noise,
    /// Choices of the scripted demonstrator.
    Demo,
    /// Redundancy samples of inverse kinematics.
    Ik,
    /// `RRTConnect` samples.
    Planner,
    /// Middle control points of Bézier curves.
    Bezier,
    /// Exploration noise.
    Explore,
    /// Which transitions a batch holds.
    Replay,
    /// Augmentation of demonstrations and batches.
    Augment,
    /// Initial weights.
    Init,
    /// Configurations in which links are looked at that may always touch.
    SelfPairs,
}

/// Bits of the ChaCha stream number that hold the index; the rest hold the [`Stream`].
const INDEX_BITS: u32 = 56;

/// The generator for use number `index` of `stream` under `seed`.
///
/// ```
/// use lpr_core::rng::{Stream, stream};
/// use rand::RngExt as _;
///
/// let draw = |seed, index| stream(seed, Stream::Planner, index).random::<u64>();
/// assert_eq!(draw(7, 0), draw(7, 0), "the same use of the same seed");
/// assert_ne!(draw(7, 0), draw(7, 1));
/// assert_ne!(draw(7, 0), stream(7, Stream::Ik, 0).random::<u64>());
/// ```
///
/// # Panics
///
/// When `index` needs more than 56 bits.
#[must_use]
pub fn stream(seed: u64, stream: Stream, index: u64) -> Rng {
    assert!(index >> INDEX_BITS == 0, "a stream index has at most 56 bits, got {index}");
    let mut rng = Rng::seed_from_u64(seed);
    rng.set_stream(((stream as u64) << INDEX_BITS) | index);
    rng
}

/// A draw from the standard normal distribution (Box and Muller 1958; the second value of the pair
/// is not used, so that every draw takes the same amount of the stream).
///
/// ```
/// use lpr_core::rng::{Stream, normal, stream};
///
/// let mut rng = stream(0, Stream::Noise, 0);
/// let draws: Vec<f32> = (0..1000).map(|_| normal(&mut rng)).collect();
/// let within_one = draws.iter().filter(|draw| draw.abs() < 1.0).count();
/// assert!((640..=730).contains(&within_one), "two of three are within a standard deviation");
/// ```
#[must_use]
pub fn normal(rng: &mut Rng) -> f32 {
    let radius = libm::sqrtf(-2.0 * libm::logf(1.0 - rng.random::<f32>()));
    radius * libm::cosf(core::f32::consts::TAU * rng.random::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng as _;

    #[test]
    fn same_arguments_same_numbers_and_any_other_argument_others() {
        let draw = |seed, s, index| stream(seed, s, index).next_u64();
        let reference = draw(7, Stream::Ik, 3);
        assert_eq!(reference, draw(7, Stream::Ik, 3));
        assert_ne!(reference, draw(8, Stream::Ik, 3));
        assert_ne!(reference, draw(7, Stream::Planner, 3));
        assert_ne!(reference, draw(7, Stream::Ik, 4));
    }

    #[test]
    fn normal_draws_have_the_moments_of_the_standard_normal() {
        let mut rng = stream(1, Stream::Noise, 0);
        let n = 40_000;
        let (mut sum, mut squares, mut within) = (0.0, 0.0, 0);
        for _ in 0..n {
            let x = f64::from(normal(&mut rng));
            sum += x;
            squares += x * x;
            within += i32::from(x.abs() < 1.0);
        }
        let n = f64::from(n);
        // Three standard errors of each.
        assert!((sum / n).abs() < 3.0 / n.sqrt());
        assert!((squares / n - 1.0).abs() < 3.0 * (2.0 / n).sqrt());
        assert!((f64::from(within) / n - 0.682_69).abs() < 3.0 * (0.683 * 0.317 / n).sqrt());
    }
}
