//! What the demonstrator does in a scene: the truth that an agent is held against.

use crate::error::Result;
use crate::in_order::map_in_order;
use crate::path::ScrewMotion;
use crate::q_attention::NextBestPose;
use crate::sim::SimEnvironment;
use crate::sim::feasibility::{KeyframeSnapshot, keyframe_snapshots};

use core::f32::consts::PI;
use core::ops::Range;
use glamx::{Pose3, Vec3};

/// A scene in which the demonstrator succeeds.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Seed of the scene.
    pub scene_seed: u64,
    /// Its start.
    pub start: SimEnvironment,
    /// The world before each of the demonstrator's motions, with where it leads.
    pub keyframes: Vec<KeyframeSnapshot>,
}

impl Reference {
    /// The demonstrated poses, one a keyframe.
    pub(super) fn goals(&self) -> Vec<NextBestPose> {
        self.keyframes.iter().map(|keyframe| keyframe.goal).collect()
    }

    /// The axis about (or along) which the demonstrator moves a joint of the scene at `keyframe`,
    /// as the motion of its grip; none where it moves no joint.
    pub(super) fn axis(&self, keyframe: usize) -> Option<ScrewMotion> {
        let snapshot = self.keyframes.get(keyframe).filter(|snapshot| snapshot.moves_a_joint())?;
        let world = snapshot.env.world();
        Some(ScrewMotion::between(&world.robot().grip(world.config()), &snapshot.goal.pose))
    }
}

/// The scenes of `seeds`, without those in which the demonstrator fails.
///
/// # Errors
///
/// When a scene cannot be placed.
pub fn references(environment: &SimEnvironment, seeds: Range<u64>) -> Result<Vec<Reference>> {
    let n = usize::try_from(seeds.end.saturating_sub(seeds.start)).unwrap_or(usize::MAX);
    let reference = |idx: usize| {
        let scene_seed = seeds.start + idx as u64;
        let mut start = environment.clone();
        crate::env::Environment::reset(&mut start, scene_seed)?;
        let keyframes = keyframe_snapshots(&start, scene_seed);
        Ok(keyframes.map(|keyframes| Reference { scene_seed, start, keyframes }))
    };
    map_in_order(n, reference).into_iter().filter_map(Result::transpose).collect()
}

/// The motion about the axis of `demonstrated` that brings a grip at `start` as near to `goal` as a
/// turn about this axis (or a slide along it) can.
pub(super) fn about_axis(demonstrated: &ScrewMotion, start: Pose3, goal: Vec3) -> ScrewMotion {
    let ScrewMotion { point, direction, angle, slide, .. } = *demonstrated;
    if angle == 0.0 {
        let slide = direction.dot(goal - start.translation);
        return ScrewMotion { start, point: start.translation, direction, angle, slide };
    }
    let across = |at: Vec3| {
        let lever = at - point;
        lever - direction.dot(lever) * direction
    };
    let (from, to) = (across(start.translation), across(goal));
    let turn = libm::atan2f(direction.dot(from.cross(to)), from.dot(to));
    // Of the two ways around, the demonstrated one.
    let turn = if turn < -0.5 * PI { turn + 2.0 * PI } else { turn };
    ScrewMotion { start, point, direction, angle: turn, slide: slide * turn / angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::FRAC_PI_2;

    #[test]
    fn a_goal_beside_the_arc_is_reached_as_near_as_the_hinge_lets() {
        let start = Pose3::from_translation(Vec3::new(0.5, 0.0, 0.1));
        let hinge = Vec3::new(0.8, 0.0, 0.1);
        let opening =
            ScrewMotion { start, point: hinge, direction: Vec3::Y, angle: FRAC_PI_2, slide: 0.0 };
        let exact = opening.pose(1.0).translation;
        let found = about_axis(&opening, start, exact + Vec3::new(0.0, 0.03, 0.02));
        assert!((found.angle - FRAC_PI_2).abs() < 1e-5, "{}", found.angle);
        assert!(found.pose(1.0).translation.distance(exact) < 1e-5);
    }

    #[test]
    fn a_drawer_slides_along_its_rail() {
        let start = Pose3::from_translation(Vec3::new(0.5, 0.2, 0.1));
        let opening = ScrewMotion {
            start,
            point: start.translation,
            direction: -Vec3::X,
            angle: 0.0,
            slide: 0.2,
        };
        let found = about_axis(&opening, start, Vec3::new(0.35, 0.24, 0.1));
        assert!(found.pose(1.0).translation.distance(Vec3::new(0.35, 0.2, 0.1)) < 1e-6);
    }
}
