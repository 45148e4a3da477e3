//! Checks of straight joint-space motions.

use super::{ArmSpheres, Scene};
use crate::robot::JointConfig;
use core::cell::Cell;

/// Checks motions of one arm in one scene at a fixed resolution, and counts the configurations it looked at.
#[derive(Debug)]
pub struct MotionChecker<'a> {
    scene: &'a Scene,
    arm: &'a ArmSpheres,
    /// Configurations per radian of joint-space distance.
    checks_per_radian: f32,
    n_checks: Cell<u64>,
}

impl<'a> MotionChecker<'a> {
    /// A checker that looks at `checks_per_radian` configurations for each radian of joint-space distance.
    #[must_use]
    pub const fn new(scene: &'a Scene, arm: &'a ArmSpheres, checks_per_radian: f32) -> Self {
        Self { scene, arm, checks_per_radian, n_checks: Cell::new(0) }
    }

    /// Configurations looked at so far.
    #[must_use]
    pub const fn n_checks(&self) -> u64 {
        self.n_checks.get()
    }

    /// Whether the arm is free at `config`.
    #[must_use]
    pub fn is_free(&self, config: &JointConfig) -> bool {
        self.n_checks.set(self.n_checks.get() + 1);
        self.scene.is_free(self.arm, config)
    }

    /// Whether the straight motion from `a`, which is not looked at, to `b` is free.
    ///
    /// The end comes first, then halves, quarters and so on: a collision anywhere on the way shows early.
    #[must_use]
    pub fn motion_is_free(&self, a: &JointConfig, b: &JointConfig) -> bool {
        if !self.is_free(b) {
            return false;
        }
        let n = libm::ceilf(a.distance(b) * self.checks_per_radian).max(1.0) as usize;
        let mut stride = n.next_power_of_two() / 2;
        while stride > 0 {
            for i in (stride..n).step_by(2 * stride) {
                if !self.is_free(&a.lerp(b, i as f32 / n as f32)) {
                    return false;
                }
            }
            stride /= 2;
        }
        true
    }

    /// Whether the path through `configs` is free, its first configuration included.
    #[must_use]
    pub fn path_is_free(&self, configs: &[JointConfig]) -> bool {
        configs.first().is_none_or(|start| self.is_free(start))
            && configs.windows(2).all(|pair| self.motion_is_free(&pair[0], &pair[1]))
    }
}
