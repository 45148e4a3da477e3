//! Free paths between configurations: the planners, the choice among them, and what makes their
//! paths shorter.

mod course;
mod kpiece;
mod plan;
mod planner;
mod rrt_connect;
mod sbl;
mod shortcut;
mod simplify;
mod stomp;
#[cfg(test)]
mod test_scenes;
mod trajopt;
mod tree;

pub use kpiece::{KpieceSettings, kpiece};
pub use plan::{FINER, Plan};
pub use planner::{PlannerKind, PlannerSettings, plan_with};
pub use rrt_connect::{RrtSettings, rrt_connect};
pub use sbl::{SblSettings, sbl};
pub use shortcut::shortcut;
pub use simplify::simplify;
pub use stomp::{StompSettings, stomp};
pub use trajopt::{TrajoptSettings, trajopt};
