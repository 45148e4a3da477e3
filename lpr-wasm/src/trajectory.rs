//! A path made a motion in time, as fast as the arm may.

use crate::planner::{Planner, TIMING};
use lpr_core::error::{Error, Result};
use lpr_core::path::{GripSpeedLimit, JointPath, MotionLimits, SmoothPath, time_optimal};
use lpr_core::robot::{DOF, JointConfig, MAX_JOINTS, Robot};
use serde::{Deserialize, Serialize};

/// Most moments that may be asked for: seven minutes at 4 ms.
const MAX_MOMENTS: f64 = 1e5;

/// Longest path, radians: a hundred times what an arm does in a task.
const MAX_LENGTH: f64 = 1000.0;

/// Configurations looked at for each radian of the curve.
const CHECKS_PER_RADIAN: f64 = 64.0;

/// A path and how it is to be driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryRequest {
    /// Configurations that the arm passes, radians: two at least.
    pub path: Vec<JointConfig>,
    /// Share of the arm's greatest joint velocities and accelerations, above 0 to 1.
    pub speed: f64,
    /// Greatest jerk of every joint at start and end, rad/s³; without it accelerations may jump.
    pub max_jerk: Option<f64>,
    /// Greatest speed of the grip, m/s.
    pub max_grip_speed: Option<f64>,
    /// Time between two moments of the answer, seconds.
    pub period: f64,
}

/// A motion from rest to rest on a smooth curve through the path's configurations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TimedTrajectory {
    /// Duration, seconds.
    pub seconds: f64,
    /// Greatest distance of the curve from the path, in joint space, radians: a bound.
    pub deviation: f64,
    /// True if the arm meets an obstacle or itself on the curve, of which the path knows nothing
    /// between its configurations.
    pub collides: bool,
    /// Moments, seconds: 0, `period`, …, and the end.
    pub times: Vec<f64>,
    /// Joint angles at each, radians; metres of sliding joints.
    pub angles: Vec<Vec<f64>>,
    /// Joint velocities at each, rad/s or m/s.
    pub velocities: Vec<Vec<f64>>,
}

impl TrajectoryRequest {
    fn limits<const N: usize>(&self, robot: &Robot) -> Result<MotionLimits<N>> {
        if !(self.speed > 0.0 && self.speed <= 1.0) {
            return Err(Error::Config(format!("speed: above 0 to 1, got {}", self.speed)));
        }
        // Joints that there are not stay where they are.
        let (mut velocity, mut acceleration) = ([1.0; N], [1.0; N]);
        for (j, joint) in robot.joints.iter().enumerate() {
            let known = Some(joint.max_acceleration).filter(|limit| limit.is_finite());
            velocity[j] = self.speed * f64::from(joint.max_velocity);
            acceleration[j] = self.speed * f64::from(known.unwrap_or(TIMING.max_acceleration));
        }
        Ok(MotionLimits { velocity, acceleration, jerk: self.max_jerk.map(|jerk| [jerk; N]) })
    }
}

impl Planner {
    /// The fastest motion along a path within the limits; a joint without one of its acceleration has
    /// that of [`TIMING`].
    ///
    /// # Errors
    ///
    /// When the path is of another number of joints, has fewer than two configurations or one that is no number, is over 1000 rad
    /// long, a limit is none, or there are over 100,000 moments.
    pub fn trajectory(&self, request: &TrajectoryRequest) -> Result<TimedTrajectory> {
        let path = JointPath::new(request.path.clone())?;
        let (found, expected) = (path.start().dof(), self.robot().dof());
        if found != expected {
            return Err(Error::Config(format!("path: {expected} joints expected, found {found}")));
        }
        if expected <= DOF {
            self.timed::<DOF>(&path, request)
        } else {
            self.timed::<MAX_JOINTS>(&path, request)
        }
    }

    fn timed<const N: usize>(
        &self,
        path: &JointPath,
        request: &TrajectoryRequest,
    ) -> Result<TimedTrajectory> {
        let curve = SmoothPath::<N>::through(path);
        if curve.chord_length() > MAX_LENGTH {
            return Err(Error::Config(format!(
                "path: at most {MAX_LENGTH} rad long, got {}",
                curve.chord_length()
            )));
        }
        let limits = request.limits(self.robot())?;
        let grip = request
            .max_grip_speed
            .map(|max_speed| GripSpeedLimit { robot: self.robot(), max_speed });
        let motion = time_optimal(&curve, &limits, grip.as_ref())?;
        let seconds = motion.duration_secs();
        if seconds / request.period > MAX_MOMENTS {
            return Err(Error::Config(format!(
                "period: {} s divides {seconds:.1} s too finely",
                request.period
            )));
        }
        let (times, states): (Vec<f64>, Vec<_>) = motion.samples(request.period)?.unzip();
        Ok(TimedTrajectory {
            seconds,
            deviation: curve.deviation(),
            collides: self.collides_on(&curve),
            times,
            angles: states.iter().map(|state| self.of_joints(&state.angles)).collect(),
            velocities: states.iter().map(|state| self.of_joints(&state.velocities)).collect(),
        })
    }

    /// The numbers of the joints that there are.
    fn of_joints(&self, numbers: &[f64]) -> Vec<f64> {
        numbers[..self.robot().dof()].to_vec()
    }

    fn collides_on<const N: usize>(&self, curve: &SmoothPath<N>) -> bool {
        let n_steps = (curve.chord_length() * CHECKS_PER_RADIAN).ceil().max(1.0);
        let at = |step: u32| {
            let angles = curve.angles_at(curve.chord_length() * f64::from(step) / n_steps);
            JointConfig::from_fn(self.robot().dof(), |j| angles[j] as f32)
        };
        let configs: Vec<_> = (0..=n_steps as u32).map(at).collect();
        !self.checker(CHECKS_PER_RADIAN as f32).path_is_free(&configs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::{Obstacles, Place, Solid};
    use lpr_core::glamx::{Quat, Vec3};
    use lpr_core::robot::XARM7;
    use lpr_core::scene::Shape;

    fn turned(turn: f32) -> JointConfig {
        JointConfig::from_fn(DOF, |j| XARM7.start[j] + if j == 0 { turn } else { 0.0 })
    }

    fn request() -> TrajectoryRequest {
        let path = vec![turned(-0.5), turned(0.0), turned(0.5)];
        TrajectoryRequest {
            path,
            speed: 0.5,
            max_jerk: Some(200.0),
            max_grip_speed: Some(0.2),
            period: 0.01,
        }
    }

    fn planner(obstacles: &Obstacles) -> Planner {
        Planner::new("xarm7", obstacles).unwrap()
    }

    #[test]
    fn a_motion_goes_from_rest_to_rest_within_its_limits() {
        let found = planner(&Obstacles::default()).trajectory(&request()).unwrap();
        assert!(!found.collides && found.deviation < 1e-6, "the path is straight");
        assert_eq!((found.times[0], *found.times.last().unwrap()), (0.0, found.seconds));
        assert!((found.angles[0][0] - f64::from(turned(-0.5)[0])).abs() < 1e-6);
        assert_eq!([&found.velocities[0], found.velocities.last().unwrap()], [&[0.0; DOF]; 2]);
        let fastest = found.velocities.iter().map(|velocity| velocity[0].abs()).fold(0.0, f64::max);
        let grip = XARM7.grip(&XARM7.start).translation;
        assert!(
            (fastest * f64::from(grip.x) - 0.2).abs() < 1e-3,
            "the grip's speed is what limits"
        );
        let free = TrajectoryRequest { max_grip_speed: None, max_jerk: None, ..request() };
        assert!(planner(&Obstacles::default()).trajectory(&free).unwrap().seconds < found.seconds);
    }

    #[test]
    fn a_ball_on_the_way_is_said() {
        let place = Place {
            position: XARM7.grip(&turned(0.25)).translation,
            rotation_xyzw: Quat::IDENTITY,
        };
        let ball = Solid { shape: Shape::Sphere { radius: 0.02 }, place };
        let obstacles = Obstacles { solids: vec![ball], ..Obstacles::default() };
        assert!(planner(&obstacles).trajectory(&request()).unwrap().collides);
        let far = Place { position: 2.0 * Vec3::X, rotation_xyzw: Quat::IDENTITY };
        let obstacles = Obstacles {
            solids: vec![Solid { place: far, ..obstacles.solids[0].clone() }],
            ..obstacles
        };
        assert!(!planner(&obstacles).trajectory(&request()).unwrap().collides);
    }

    #[test]
    fn what_cannot_be_is_named() {
        let planner = planner(&Obstacles::default());
        let refusal = |change: fn(&mut TrajectoryRequest)| {
            let mut request = request();
            change(&mut request);
            planner.trajectory(&request).unwrap_err().to_string()
        };
        assert!(refusal(|request| request.path.truncate(1)).contains("path"));
        assert!(refusal(|request| request.path[1][3] = f32::NAN).contains("path"));
        let short = |request: &mut TrajectoryRequest| {
            request.path = vec![JointConfig::new([0.0; 4]), JointConfig::new([1.0; 4])];
        };
        assert!(refusal(short).contains("path: 7 joints expected, found 4"));
        assert!(
            refusal(|request| (request.path[1][3], request.period) = (1e30, 1e30))
                .contains("path: at most 1000 rad")
        );
        assert!(refusal(|request| request.speed = 1.5).contains("speed"));
        assert!(refusal(|request| request.speed = f64::NAN).contains("speed"));
        assert!(refusal(|request| request.max_jerk = Some(-1.0)).contains("jerk"));
        assert!(refusal(|request| request.max_grip_speed = Some(0.0)).contains("grip_speed"));
        assert!(refusal(|request| request.period = 1e-9).contains("period"));
        assert!(refusal(|request| request.period = 0.0).contains("period"));
    }
}
