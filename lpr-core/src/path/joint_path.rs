//! The path itself: configurations joined linearly.

use crate::error::{Error, Result};
use crate::robot::JointConfig;

/// A path of the arm: at least two configurations, joined linearly in joint space.
///
/// `ξ = [c_1, …, c_T]` in the paper (section IV).
///
/// ```
/// use lpr_core::path::JointPath;
/// use lpr_core::robot::{JointConfig, XARM7};
///
/// let goal = XARM7.start.map(|q| q + 0.2);
/// let path = JointPath::new(vec![XARM7.start, goal])?;
/// assert_eq!((path.start(), path.goal()), (&XARM7.start, &goal));
/// assert!((path.length() - 0.2 * 7_f32.sqrt()).abs() < 1e-5, "radians, over all joints");
///
/// assert!(JointPath::new(vec![goal]).is_err(), "one configuration is no path");
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointPath(pub(super) Vec<JointConfig>);

impl JointPath {
    /// A path through `configs`.
    ///
    /// # Errors
    ///
    /// With fewer than two configurations, or with one that is not finite.
    pub fn new(configs: Vec<JointConfig>) -> Result<Self> {
        if configs.len() < 2 {
            return Err(Error::Shape {
                what: "path",
                expected: "at least 2 configurations".to_owned(),
                found: format!("{}", configs.len()),
            });
        }
        if let Some(idx) = configs.iter().position(|config| !config.is_finite()) {
            return Err(Error::Shape {
                what: "path",
                expected: "finite joint angles".to_owned(),
                found: format!("{:?} at index {idx}", &configs[idx][..]),
            });
        }
        if let Some(idx) = configs.iter().position(|config| config.dof() != configs[0].dof()) {
            return Err(Error::Shape {
                what: "path",
                expected: format!("configurations of {} joints", configs[0].dof()),
                found: format!("{} at index {idx}", configs[idx].dof()),
            });
        }
        Ok(Self(configs))
    }

    /// The configurations.
    #[must_use]
    pub fn configs(&self) -> &[JointConfig] {
        &self.0
    }

    /// First configuration.
    #[must_use]
    pub fn start(&self) -> &JointConfig {
        &self.0[0]
    }

    /// Last configuration.
    #[must_use]
    pub fn goal(&self) -> &JointConfig {
        &self.0[self.0.len() - 1]
    }

    /// Length in configuration space: the sum of Euclidean distances, radians.
    #[must_use]
    pub fn length(&self) -> f32 {
        path_length(&self.0)
    }

    /// The path at `n_configs` points equally spaced in joint-space arc length; both ends are
    /// exact.
    ///
    /// ```
    /// use lpr_core::path::JointPath;
    /// use lpr_core::robot::JointConfig;
    ///
    /// let at = |q: f32| JointConfig::new([q, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    /// let path = JointPath::new(vec![at(0.0), at(0.1), at(1.0)])?;
    /// assert_eq!(path.resample(3).configs(), [at(0.0), at(0.5), at(1.0)], "the corner at 0.1 is cut");
    /// assert_eq!(path.subdivide(4).configs(), [at(0.0), at(0.1), at(0.55), at(1.0)], "subdividing keeps it");
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Panics
    ///
    /// When `n_configs` is below 2.
    #[must_use]
    pub fn resample(&self, n_configs: usize) -> Self {
        assert!(n_configs >= 2, "a path has at least 2 configurations, asked for {n_configs}");
        let total = self.length();
        let mut resampled = Vec::with_capacity(n_configs);
        resampled.push(*self.start());
        let mut segment = 0;
        let mut before = 0.0;
        for i in 1..n_configs - 1 {
            let target = total * i as f32 / (n_configs - 1) as f32;
            let mut length = self.0[segment].distance(&self.0[segment + 1]);
            while before + length < target && segment + 2 < self.0.len() {
                before += length;
                segment += 1;
                length = self.0[segment].distance(&self.0[segment + 1]);
            }
            let fraction =
                if length > 0.0 { ((target - before) / length).clamp(0.0, 1.0) } else { 0.0 };
            resampled.push(self.0[segment].lerp(&self.0[segment + 1], fraction));
        }
        resampled.push(*self.goal());
        Self(resampled)
    }

    /// The same polyline with `n_configs` configurations: every corner stays, and further points
    /// divide the longest pieces.
    ///
    /// A path with more corners than that is [resampled](Self::resample), which cuts them.
    ///
    /// # Panics
    ///
    /// When `n_configs` is below 2.
    #[must_use]
    pub fn subdivide(&self, n_configs: usize) -> Self {
        if self.0.len() > n_configs {
            return self.resample(n_configs);
        }
        let lengths: Vec<f32> = self.0.windows(2).map(|pair| pair[0].distance(&pair[1])).collect();
        let mut pieces = vec![1_usize; lengths.len()];
        for _ in self.0.len()..n_configs {
            let mut longest = 0;
            for (idx, length) in lengths.iter().enumerate() {
                if length / pieces[idx] as f32 > lengths[longest] / pieces[longest] as f32 {
                    longest = idx;
                }
            }
            pieces[longest] += 1;
        }
        let mut divided = vec![*self.start()];
        for (pair, n) in self.0.windows(2).zip(pieces) {
            divided.extend((1..n).map(|i| pair[0].lerp(&pair[1], i as f32 / n as f32)));
            divided.push(pair[1]);
        }
        Self(divided)
    }
}

/// Sum of the distances between neighbours, radians.
pub(super) fn path_length(configs: &[JointConfig]) -> f32 {
    configs.windows(2).map(|pair| pair[0].distance(&pair[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::DOF;
    use proptest::prelude::*;

    fn path() -> impl Strategy<Value = JointPath> {
        prop::collection::vec(prop::array::uniform7(-3.0_f32..3.0).prop_map(JointConfig::new), 2..9)
            .prop_map(JointPath)
    }

    proptest! {
        #[test]
        fn resampling_keeps_the_ends_and_never_lengthens(path in path(), n in 2..40_usize) {
            for other in [path.resample(n), path.subdivide(n)] {
                prop_assert_eq!(other.configs().len(), n);
                prop_assert_eq!(other.start(), path.start());
                prop_assert_eq!(other.goal(), path.goal());
                prop_assert!(other.length() <= path.length() * (1.0 + 1e-5));
            }
        }

        #[test]
        fn subdividing_keeps_every_corner(path in path(), more in 0..30_usize) {
            let divided = path.subdivide(path.configs().len() + more);
            prop_assert!(path.configs().iter().all(|corner| divided.configs().contains(corner)));
            prop_assert!((divided.length() - path.length()).abs() < 1e-4);
        }

        #[test]
        fn resampled_points_are_equally_spaced_along_a_straight_path(path in path(), n in 3..40_usize) {
            let straight = JointPath(vec![*path.start(), *path.goal()]);
            let (resampled, step) = (straight.resample(n), straight.length() / (n - 1) as f32);
            for pair in resampled.configs().windows(2) {
                prop_assert!((pair[0].distance(&pair[1]) - step).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn a_path_needs_two_finite_configurations() {
        let rest = JointConfig::new([0.0; DOF]);
        assert!(JointPath::new(vec![rest]).is_err());
        assert!(JointPath::new(vec![rest, JointConfig::new([f32::NAN; DOF])]).is_err());
        assert!(JointPath::new(vec![rest, rest]).is_ok());
    }
}
