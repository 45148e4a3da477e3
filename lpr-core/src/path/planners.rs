//! Free paths between configurations: the planners, the choice among them, and what makes their
//! paths shorter.

#[cfg(feature = "planners")]
mod course;
#[cfg(feature = "planners")]
mod kpiece;
mod plan;
mod planner;
mod rrt_connect;
#[cfg(feature = "planners")]
mod sbl;
mod shortcut;
mod simplify;
#[cfg(feature = "planners")]
mod stomp;
#[cfg(test)]
mod test_scenes;
#[cfg(feature = "planners")]
mod trajopt;
mod tree;

#[cfg(feature = "planners")]
pub use kpiece::{KpieceSettings, kpiece};
pub use plan::{FINER, Plan};
pub use planner::{PlannerKind, PlannerSettings, plan_with};
pub use rrt_connect::{RrtSettings, rrt_connect};
#[cfg(feature = "planners")]
pub use sbl::{SblSettings, sbl};
pub use shortcut::shortcut;
pub use simplify::simplify;
#[cfg(feature = "planners")]
pub use stomp::{StompSettings, stomp};
#[cfg(feature = "planners")]
pub use trajopt::{TrajoptSettings, trajopt};
