//! The half turn of a grasp: turning a two-finger gripper by 180° about its approach changes nothing,
//! as long as it holds nothing.
//!
//! So there are two right orientations of every grasp, and two of the hand in every observation, and
//! a network that is taught by examples needs one rule for all of them: [`HalfTurn::Relative`].
//!
//! - *Seen*: of the hand's two orientations, networks are shown the canonical one.
//! - *Empty hand*: the label is the canonical orientation of the grasp; the agent turns to the one
//!   that is nearer to its hand.
//! - *Hand that holds something*: only one turn is right, that which brings the thing where it
//!   belongs. The label is the pose that a hand in its canonical orientation would go to, and what
//!   the network says is turned as the hand is.
//!
//! A perfect label, acted, is then the demonstrated pose relative to what is held, whichever of the
//! two turns the hand took.
//!
//! # Canonical orientation
//!
//! It must not change with the yaw of a scene where it need not, since augmentation turns scenes.
//! Farther than [`UPRIGHT`] from straight down, height tells the two apart: the sign of
//! `cos 30° x.z + sin 30° y.z` of the grip's axes, whose zero lies between level, upright and
//! diagonal. Straight down, where both axes are level, there is only the yaw: the one nearer to
//! [`REFERENCE`].
//!
//! # Differences from the paper
//!
//! The released C2F-ARM learns the demonstrated quaternion as it is ([`HalfTurn::Ignored`]).

use crate::perception::Proprio;

use glamx::{Quat, Vec3};
use serde::{Deserialize, Serialize};

/// Orientation that a grasp from above stays near: pointing down, turned by 20° about the vertical,
/// as a quaternion xyzw.
///
/// Pointing down is how both arms start; 20° keep the place where the choice flips, 90° away from
/// it, off the level and upright orientations that tasks are made of.
const REFERENCE: Quat = Quat::from_xyzw(0.984_807_7, 0.173_648_18, 0.0, 0.0);

/// Cosine of the angle from straight down up to which a grasp counts as one from above: 25°.
const UPRIGHT: f32 = 0.906_307_8;

/// Weights of the heights of x and y: cosine and sine of 30°.
const HEIGHTS: [f32; 2] = [0.866_025_4, 0.5];

/// What is done about the half turn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HalfTurn {
    /// Nothing, as in the released C2F-ARM: demonstrations that grasp both ways teach both.
    Ignored,
    /// Labels are the orientation nearer to one of the world, acting turns to the one nearer to
    /// the hand whatever it holds, and networks see the hand as it is. What runs before there was
    /// a choice did: it cannot lay a held thing down by a quarter turn.
    #[default]
    Nearest,
    /// The rule of this module.
    Relative,
}

/// The hand when a pose is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Orientation of `grip` in the world.
    pub rotation: Quat,
    /// True if it holds something.
    pub holds: bool,
}

impl Hand {
    /// The hand that `proprio` tells of.
    #[must_use]
    pub fn of(proprio: &Proprio) -> Self {
        Self { rotation: proprio.grip.rotation, holds: proprio.holds() }
    }
}

impl HalfTurn {
    /// The orientation that a network learns for going to `goal` with that hand.
    #[must_use]
    pub fn label(self, goal: Quat, hand: Hand) -> Quat {
        match self {
            Self::Ignored => goal,
            Self::Nearest => nearest(goal, REFERENCE),
            Self::Relative if hand.holds => as_turned(goal, hand.rotation),
            Self::Relative => canonical_grasp(goal),
        }
    }

    /// The orientation to go to with that hand when a network says `label`: the inverse of
    /// [`Self::label`], up to the half turn of an empty hand.
    #[must_use]
    pub fn acted(self, label: Quat, hand: Hand) -> Quat {
        match self {
            Self::Ignored => label,
            // A half turn is its own inverse.
            Self::Relative if hand.holds => as_turned(label, hand.rotation),
            Self::Nearest | Self::Relative => nearest(label, hand.rotation),
        }
    }

    /// The hand's orientation as networks see it.
    #[must_use]
    pub fn seen(self, rotation: Quat) -> Quat {
        match self {
            Self::Ignored | Self::Nearest => rotation,
            Self::Relative => canonical_grasp(rotation),
        }
    }
}

/// Of the two orientations that grasp the same, 180° about the approach apart, the canonical one.
///
/// ```
/// use lpr_core::glamx::Quat;
/// use lpr_core::q_attention::canonical_grasp;
///
/// let down = Quat::from_rotation_x(core::f32::consts::PI);
/// let turned = down * Quat::from_rotation_z(core::f32::consts::PI);
/// assert!(canonical_grasp(turned).angle_between(canonical_grasp(down)) < 1e-3, "the same grasp");
/// ```
#[must_use]
pub fn canonical_grasp(rotation: Quat) -> Quat {
    if is_canonical(rotation) { rotation } else { half_turned(rotation) }
}

/// `rotation` with the half turn about its approach.
#[must_use]
pub fn half_turned(rotation: Quat) -> Quat {
    rotation * Quat::from_xyzw(0.0, 0.0, 1.0, 0.0)
}

/// `rotation`, half turned if that hand is not in its canonical orientation.
fn as_turned(rotation: Quat, hand: Quat) -> Quat {
    if is_canonical(hand) { rotation } else { half_turned(rotation) }
}

fn is_canonical(rotation: Quat) -> bool {
    if (rotation * Vec3::Z).z < -UPRIGHT {
        return is_nearer(rotation, REFERENCE);
    }
    HEIGHTS[0] * (rotation * Vec3::X).z + HEIGHTS[1] * (rotation * Vec3::Y).z >= 0.0
}

/// Of the two orientations that grasp the same, the one nearer to `reference`.
fn nearest(rotation: Quat, reference: Quat) -> Quat {
    if is_nearer(rotation, reference) { rotation } else { half_turned(rotation) }
}

/// True if `rotation` is at least as near to `reference` as its half turn.
fn is_nearer(rotation: Quat, reference: Quat) -> bool {
    // Turning by 180° about z swaps w and z: the angle to the reference is the smaller the larger
    // |w| is.
    let between = reference.inverse() * rotation;
    between.w.abs() >= between.z.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use proptest::prelude::{Strategy, any, prop_assert, prop_assume, proptest};

    fn rotations() -> impl Strategy<Value = Quat> {
        [-1.0_f32..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0]
            .prop_filter("too short to normalise", |q| q.iter().map(|v| v * v).sum::<f32>() > 1e-2)
            .prop_map(|q| Quat::from_array(q).normalize())
    }

    fn angle(a: Quat, b: Quat) -> f32 {
        2.0 * (a.inverse() * b).xyz().length().min(1.0).asin()
    }

    /// Distance from where either of two orientations may be the canonical one.
    fn from_tie(rotation: Quat) -> f32 {
        let down = (rotation * Vec3::Z).z + UPRIGHT;
        let between = REFERENCE.inverse() * rotation;
        let [x, y] = [Vec3::X, Vec3::Y].map(|axis| (rotation * axis).z);
        let tie = if down < 0.0 {
            between.w.abs() - between.z.abs()
        } else {
            HEIGHTS[0] * x + HEIGHTS[1] * y
        };
        tie.abs().min(down.abs())
    }

    proptest! {
        #[test]
        fn both_sides_of_a_grasp_are_one(rotation in rotations()) {
            let [a, b] = [rotation, half_turned(rotation)].map(canonical_grasp);
            prop_assert!(angle(a, b) < 1e-3 || from_tie(rotation) < 1e-4);
            prop_assert!(angle(a, rotation).min(angle(a, half_turned(rotation))) < 1e-3);
        }

        #[test]
        fn no_yaw_changes_the_side_of_a_grasp_that_does_not_come_from_above(rotation in rotations(), yaw in -PI..PI) {
            let turned = Quat::from_rotation_z(yaw) * rotation;
            let comes_from_above = (rotation * Vec3::Z).z < -UPRIGHT;
            prop_assert!(comes_from_above || from_tie(rotation) < 1e-4 || is_canonical(turned) == is_canonical(rotation));
        }

        #[test]
        fn a_label_acted_moves_what_is_held_as_demonstrated(
            goal in rotations(), hand in rotations(), holds in any::<bool>(), other in any::<bool>(),
        ) {
            let taught = Hand { rotation: hand, holds };
            // The agent's hand grasped the other way round.
            let acting = Hand { rotation: if other { half_turned(hand) } else { hand }, holds };
            prop_assume!(from_tie(hand) > 1e-4);
            let rule = HalfTurn::Relative;
            prop_assert!(angle(rule.seen(taught.rotation), rule.seen(acting.rotation)) < 1e-3);
            let acted = rule.acted(rule.label(goal, taught), acting);
            if holds {
                // The same motion of what is held.
                let motion = |goal: Quat, hand: Hand| goal * hand.rotation.inverse();
                prop_assert!(angle(motion(goal, taught), motion(acted, acting)) < 1e-3);
            } else {
                let turn = |goal: Quat| angle(goal, acting.rotation);
                prop_assert!(angle(acted, goal).min(angle(acted, half_turned(goal))) < 1e-3);
                prop_assert!(turn(acted) < turn(half_turned(acted)) + 1e-3);
            }
        }

        #[test]
        fn where_it_is_ignored_labels_are_what_was_demonstrated(goal in rotations(), hand in rotations(), holds in any::<bool>()) {
            let hand = Hand { rotation: hand, holds };
            let rule = HalfTurn::Ignored;
            prop_assert!(rule.label(goal, hand) == goal && rule.acted(goal, hand) == goal && rule.seen(goal) == goal);
        }
    }

    #[test]
    fn a_grasp_from_above_keeps_a_yaw_near_the_start() {
        for yaw_deg in [-170.0_f32, -80.0, -60.0, 0.0, 60.0, 100.0, 120.0, 179.0] {
            let rotation = Quat::from_rotation_z(yaw_deg.to_radians()) * Quat::from_rotation_x(PI);
            for kept in [canonical_grasp(rotation), nearest(rotation, REFERENCE)] {
                let kept = kept * Vec3::X;
                let yaw = kept.y.atan2(kept.x).to_degrees();
                assert!((-70.0..=110.0).contains(&yaw), "{yaw_deg} became {yaw}");
            }
        }
        let reference = Quat::from_rotation_z(20_f32.to_radians()) * Quat::from_rotation_x(PI);
        assert!(angle(reference, REFERENCE) < 1e-3);
        assert!((REFERENCE.length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_bottle_held_either_way_round_is_laid_with_its_neck_to_the_same_side() {
        // Held level from the side, laid down by a quarter turn about the approach.
        let grasp = Quat::from_rotation_y(0.5 * PI);
        let laid = Quat::from_rotation_x(0.5 * PI) * grasp;
        let taught = Hand { rotation: grasp, holds: true };
        for hand in [grasp, half_turned(grasp)] {
            let acted = HalfTurn::Relative.acted(
                HalfTurn::Relative.label(laid, taught),
                Hand { rotation: hand, holds: true },
            );
            let lies = acted * hand.inverse();
            assert!(angle(lies, Quat::from_rotation_x(0.5 * PI)) < 1e-3, "{lies}");
        }
    }
}
