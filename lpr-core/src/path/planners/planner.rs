//! All planners behind one function: `RRTConnect` and, with the feature `planners`, those that the
//! paper names as future work.

#[cfg(feature = "planners")]
use super::kpiece::{KpieceSettings, kpiece};
use super::plan::Plan;
use super::rrt_connect::{RrtSettings, rrt_connect};
#[cfg(feature = "planners")]
use super::sbl::{SblSettings, sbl};
#[cfg(feature = "planners")]
use super::stomp::{StompSettings, stomp};
#[cfg(feature = "planners")]
use super::trajopt::{TrajoptSettings, trajopt};
use crate::check::one_of;
use crate::error::{Error, Result};
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;
use serde::{Deserialize, Serialize};

/// The words of the planners that the feature `planners` brings.
const FURTHER: [&str; 4] = ["sbl", "kpiece", "trajopt", "stomp"];

/// The choice of a planner. All but the paper's need the feature `planners`.
///
/// ```
/// use lpr_core::path::PlannerKind;
///
/// assert_eq!(PlannerKind::by_name("rrt-connect"), Ok(PlannerKind::default()));
/// let message = PlannerKind::by_name("prm").unwrap_err().to_string();
/// assert!(message.starts_with("configuration: planner: expected one of rrt-connect"), "{message}");
/// assert!(message.ends_with("found 'prm'"), "{message}");
/// ```
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    strum::IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(try_from = "String", into = "&'static str")]
pub enum PlannerKind {
    /// [`rrt_connect`], the paper's.
    #[default]
    RrtConnect,
    /// [`sbl`].
    #[cfg(feature = "planners")]
    Sbl,
    /// [`kpiece`].
    #[cfg(feature = "planners")]
    Kpiece,
    /// [`trajopt`].
    #[cfg(feature = "planners")]
    #[strum(serialize = "trajopt")]
    TrajOpt,
    /// [`stomp`].
    #[cfg(feature = "planners")]
    Stomp,
}

impl PlannerKind {
    /// All that this build has.
    pub const ALL: &[Self] = &[
        Self::RrtConnect,
        #[cfg(feature = "planners")]
        Self::Sbl,
        #[cfg(feature = "planners")]
        Self::Kpiece,
        #[cfg(feature = "planners")]
        Self::TrajOpt,
        #[cfg(feature = "planners")]
        Self::Stomp,
    ];

    /// A fixed word for files, the command line and counting.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The planner of that name.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when there is none of that name, or this build leaves it out.
    pub fn by_name(name: &str) -> Result<Self> {
        let kind = Self::ALL.iter().find(|kind| kind.name() == name);
        kind.copied().ok_or_else(|| Error::Config(refusal(name, Self::ALL)))
    }

    /// True for `RRTConnect`, which settings files need not name.
    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "serde hands a reference to what decides on skipping"
    )]
    pub(in crate::path) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The refusal of a planner that is not among those of the build.
fn refusal(name: &str, built: &[PlannerKind]) -> String {
    let why = if FURTHER.contains(&name) { " (built without the feature planners)" } else { "" };
    format!("planner: {}{why}", one_of(built.iter().map(|kind| kind.name()), name))
}

impl TryFrom<String> for PlannerKind {
    type Error = Error;

    fn try_from(name: String) -> Result<Self> {
        Self::by_name(&name)
    }
}

/// Numbers of every planner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerSettings {
    /// Of [`rrt_connect`].
    pub rrt: RrtSettings,
    /// Of [`sbl`].
    #[cfg(feature = "planners")]
    pub sbl: SblSettings,
    /// Of [`kpiece`].
    #[cfg(feature = "planners")]
    pub kpiece: KpieceSettings,
    /// Of [`trajopt`].
    #[cfg(feature = "planners")]
    pub trajopt: TrajoptSettings,
    /// Of [`stomp`].
    #[cfg(feature = "planners")]
    pub stomp: StompSettings,
}

impl PlannerSettings {
    /// The standard numbers of all planners beside `RRTConnect`, whose are given.
    #[must_use]
    pub const fn standard(rrt: RrtSettings) -> Self {
        Self {
            rrt,
            #[cfg(feature = "planners")]
            sbl: SblSettings::STANDARD,
            #[cfg(feature = "planners")]
            kpiece: KpieceSettings::STANDARD,
            #[cfg(feature = "planners")]
            trajopt: TrajoptSettings::STANDARD,
            #[cfg(feature = "planners")]
            stomp: StompSettings::STANDARD,
        }
    }
}

/// A free path from `start` to any of `goals` by the planner `kind`.
///
/// ```
/// use lpr_core::path::{PlannerKind, PlannerSettings, Rejection, RrtSettings, plan_with};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::PANDA;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// let around_the_hand = Primitive::Sphere { center: PANDA.grip(&PANDA.start).translation, radius: 0.05 };
/// let (scene, arm) = (Scene::from_primitives(vec![around_the_hand]), ArmSpheres::new(&PANDA));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let settings = PlannerSettings::standard(RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 5000 });
/// for &kind in PlannerKind::ALL {
///     let rng = &mut stream(0, Stream::Planner, 0);
///     let plan = plan_with(kind, &checker, &PANDA.start, &[PANDA.start], &settings, rng);
///     assert_eq!(plan, Err(Rejection::StartCollides), "{}", kind.name());
/// }
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no path within the planner's budget.
pub fn plan_with(
    kind: PlannerKind,
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &PlannerSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    match kind {
        PlannerKind::RrtConnect => rrt_connect(checker, start, goals, &settings.rrt, rng),
        #[cfg(feature = "planners")]
        PlannerKind::Sbl => sbl(checker, start, goals, &settings.sbl, rng),
        #[cfg(feature = "planners")]
        PlannerKind::Kpiece => kpiece(checker, start, goals, &settings.kpiece, rng),
        #[cfg(feature = "planners")]
        PlannerKind::TrajOpt => trajopt(checker, start, goals, &settings.trajopt, rng),
        #[cfg(feature = "planners")]
        PlannerKind::Stomp => stomp(checker, start, goals, &settings.stomp, rng),
    }
}

#[cfg(all(test, feature = "planners"))]
mod tests;
