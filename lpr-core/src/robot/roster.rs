//! The built-in arms by name.

use super::{Error, PANDA, Result, Robot, XARM7};
use crate::check::one_of;
use std::sync::{Arc, LazyLock};

/// The built-in robots; the first is the default.
///
/// ```
/// use lpr_core::robot::ROBOTS;
///
/// assert_eq!(ROBOTS.map(|robot| robot.name.as_str()), ["xarm7", "panda"]);
/// assert!(ROBOTS.iter().all(|robot| robot.within_limits(&robot.start) && !robot.self_collides(&robot.start)));
/// ```
pub static ROBOTS: [&LazyLock<Arc<Robot>>; 2] = [&XARM7, &PANDA];

impl Robot {
    /// The built-in robot of that name.
    ///
    /// ```
    /// use lpr_core::robot::Robot;
    ///
    /// assert_eq!(Robot::by_name("panda")?.gripper()?.max_width, 0.08);
    /// assert_eq!(Robot::by_name("ur5").unwrap_err().to_string(), "robot: expected one of xarm7, panda, found 'ur5'");
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When there is none, naming those that exist.
    pub fn by_name(name: &str) -> Result<Arc<Self>> {
        let robot = ROBOTS.iter().find(|robot| robot.name == name);
        robot.map(|robot| Arc::clone(robot)).ok_or_else(|| {
            Error::Robot(one_of(ROBOTS.iter().map(|robot| robot.name.as_str()), name))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_robots_are_an_error_that_names_the_known_ones() {
        assert_eq!(Robot::by_name("panda").map(|robot| robot.name.clone()), Ok("panda".to_owned()));
        let error = Robot::by_name("ur5").expect_err("not built in").to_string();
        assert!(
            error.contains("ur5") && error.contains("xarm7") && error.contains("panda"),
            "{error}"
        );
    }
}
