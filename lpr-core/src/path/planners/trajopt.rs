//! `TrajOpt`: a path improved by convex problems, each an approximation that is trusted near the
//! path that it was made at.
//!
//! "Motion planning with sequential convex optimization and convex collision checking" (IJRR 2014):
//!
//! ```text
//! minimise  w/2 Σ |ξ_t+1 - ξ_t|²  +  μ Σ max(0, d_safe - d_i(ξ))      within the joint limits
//! ```
//!
//! with the gaps `d_i` linear near the path, a box around the path in which that is trusted, and a
//! penalty `μ` that grows until no gap is short. Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - Gaps are those of spheres at a few configurations between waypoints, not of the hulls that
//!   links sweep.
//! - The convex problems are solved by ascent in their dual, one multiplier after the other
//!   ([`convex`]), not by a general solver.
//! - It ends with the first path that is free, not at a minimum, and begins anew through random
//!   configurations rather than chosen ones (see [`TrajoptSettings::beginnings`]).

mod convex;

use super::course::{Beginnings, Optimized, Touch, optimize_beginnings, touches};
use super::plan::{Plan, search_twice};
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;
use convex::{Convex, energy};
use serde::{Deserialize, Serialize};

/// Numbers of [`trajopt`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajoptSettings {
    /// Waypoints between the ends.
    pub waypoints: usize,
    /// Configurations looked at on the way from one waypoint to the next, that included.
    pub looks: usize,
    /// Gap that is kept to obstacles and other links (`d_safe` in the paper), metres.
    pub safe_distance: f32,
    /// Gaps below this are in the convex problems, metres: more than the safe distance, since they
    /// may shrink in a step.
    pub seen_distance: f32,
    /// Penalty on a metre of a gap short of the safe distance at first (`μ` in the paper), radians²
    /// per metre.
    pub penalty: f32,
    /// Factor of the penalty when it does not suffice.
    pub penalty_growth: f32,
    /// Times that the penalty grows.
    pub growths: u32,
    /// Furthest that a joint of a waypoint moves in the first step, radians.
    pub trust: f32,
    /// Least such distance: below it, the penalty grows.
    pub least_trust: f32,
    /// Factor of that distance after a step that gains what was expected.
    pub trust_growth: f32,
    /// Factor of that distance after one that does not.
    pub trust_shrink: f32,
    /// Share of the expected gain that a step has to bring.
    pub accepted_gain: f32,
    /// Relative gain below which the penalty grows.
    pub least_gain: f32,
    /// Most passes over the multipliers of a convex problem.
    pub sweeps: u32,
    /// Convex problems for one beginning.
    pub steps: u32,
    /// Beginnings: the straight motion to every goal, then motions through a random configuration.
    pub beginnings: u32,
}

impl TrajoptSettings {
    /// The numbers that the command line and candidate sets use.
    ///
    /// Accepted gain and growth of penalty and trust as in the authors' program, the others by
    /// trial on 210 problems of MotionBenchMaker.
    pub const STANDARD: Self = Self {
        waypoints: 16,
        looks: 3,
        safe_distance: 0.025,
        seen_distance: 0.05,
        penalty: 20.0,
        penalty_growth: 10.0,
        growths: 2,
        trust: 0.3,
        least_trust: 1e-3,
        trust_growth: 1.5,
        trust_shrink: 0.2,
        accepted_gain: 0.25,
        least_gain: 1e-3,
        sweeps: 20,
        steps: 40,
        beginnings: 30,
    };
}

/// A free path from `start` to one of `goals`.
///
/// The path found is looked at once more, as in [`rrt_connect`](super::rrt_connect).
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{Rejection, TrajoptSettings, trajopt};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// // A post where the hand is at the start.
/// let top = XARM7.grip(&XARM7.start).translation;
/// let post = Primitive::Capsule { a: Vec3 { z: 0.0, ..top }, b: top, radius: 0.03 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let (mut start, mut goal) = (XARM7.start, XARM7.start);
/// (start[0], goal[0]) = (0.7, -0.7);
/// let plan = trajopt(&checker, &start, &[goal], &TrajoptSettings::STANDARD, &mut stream(0, Stream::Planner, 0))?;
/// assert!(checker.path_is_free(plan.path.configs()));
/// assert!(plan.path.length() < 1.5 * start.distance(&goal), "close by the straight way, from which it began");
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no free path from any beginning.
pub fn trajopt(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &TrajoptSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    let beginnings = Beginnings { waypoints: settings.waypoints, count: settings.beginnings };
    search_twice(checker, start, goals, |checker, goals| {
        optimize_beginnings(checker, start, goals, beginnings, rng, |course, _| {
            optimize(checker, course, settings)
        })
    })
}

/// State of an optimisation.
struct State {
    course: Vec<JointConfig>,
    /// Everything that the arm is nearer to there than the seen distance.
    near: Vec<Touch>,
    penalty: f32,
    trust: f32,
}

/// Outcome of one convex problem.
enum Step {
    /// The course moved.
    Moved,
    /// The approximation did not hold as far as it was trusted.
    Shrunk,
    /// With this penalty nothing is to be gained.
    Done,
}

fn optimize(
    checker: &MotionChecker<'_>,
    course: &[JointConfig],
    settings: &TrajoptSettings,
) -> Optimized {
    let near = touches(checker, course, settings.looks, settings.seen_distance);
    let mut state =
        State { course: course.to_vec(), near, penalty: settings.penalty, trust: settings.trust };
    let mut growths = 0;
    for step in 1..=settings.steps {
        if checker.is_stopped() {
            break;
        }
        match advance(&mut state, checker, settings) {
            Step::Moved if checker.path_is_free(&state.course) => {
                return Optimized { course: Some(state.course), steps: step };
            }
            Step::Moved => {}
            Step::Shrunk if state.trust >= settings.least_trust => {}
            Step::Shrunk | Step::Done if growths == settings.growths => {
                return Optimized { course: None, steps: step };
            }
            Step::Shrunk | Step::Done => {
                // Another penalty is another problem: it is trusted as far as the first.
                growths += 1;
                state.penalty *= settings.penalty_growth;
                state.trust = settings.trust;
            }
        }
    }
    Optimized { course: None, steps: settings.steps }
}

/// Solves one convex problem and moves there, if the cost falls by enough of what the approximation
/// promised.
fn advance(state: &mut State, checker: &MotionChecker<'_>, settings: &TrajoptSettings) -> Step {
    let limits = checker.arm().limits();
    let convex = Convex::new(&state.course, &state.near, settings.safe_distance, state.penalty);
    let moved = convex.solve(&state.course, state.trust, limits, settings.sweeps);
    let before = cost(&state.course, &state.near, state.penalty, settings);
    let promised = before - convex.cost(&moved);
    if promised <= settings.least_gain * before {
        return Step::Done;
    }
    // The approximation knows only the gaps near the old path; new ones may have come near.
    let near = touches(checker, &moved, settings.looks, settings.seen_distance);
    let gained = before - cost(&moved, &near, state.penalty, settings);
    if gained < settings.accepted_gain * promised {
        state.trust *= settings.trust_shrink;
        return Step::Shrunk;
    }
    state.trust *= settings.trust_growth;
    (state.course, state.near) = (moved, near);
    Step::Moved
}

/// The cost itself, of which the convex problems are approximations.
fn cost(course: &[JointConfig], near: &[Touch], penalty: f32, settings: &TrajoptSettings) -> f32 {
    energy(course)
        + penalty * near.iter().map(|touch| touch.shortfall(settings.safe_distance)).sum::<f32>()
}
