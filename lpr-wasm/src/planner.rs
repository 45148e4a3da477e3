//! Planning without an agent: inverse kinematics, a path among obstacles, candidate paths. In and
//! out go values with JSON.

use lpr_core::error::{Error, Result};
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::path::{
    BezierSettings, CandidatePath, CandidateSettings, CandidateStreams, PathQuery, PlannerKind,
    RejectedPath, RrtSettings, TimedPath, TimingSettings, candidates, rrt_connect, simplify,
};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{JointConfig, Robot};
use lpr_core::scene::{
    ArmSpheres, MotionChecker, POINT_RADIUS, Primitive, Scene, Shape, VOXEL, downsample,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Numbers of the candidate set, those of the preset `fast`; a plan goes to as many configurations
/// as it has planner paths.
pub const CANDIDATES: CandidateSettings = CandidateSettings {
    path_len: 30,
    planner: PlannerKind::RrtConnect,
    planner_paths: 20,
    bezier_paths: 20,
    screw_paths: 0,
    planner_collision_free_fraction: 0.5,
    draws_per_path: 5,
    min_goal_distance: 0.2,
    rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
    bezier: BezierSettings { sigma: 0.07 },
    refinement: None,
};

/// The planner of one path, which may take longer than one of a candidate set.
const PLANNER: RrtSettings = RrtSettings { max_iterations: 5000, ..CANDIDATES.rrt };

/// Speed of the arm, that of the preset `fast`.
pub const TIMING: TimingSettings = TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 };

/// Most configurations of a pose that may be asked for.
const MAX_CONFIGURATIONS: usize = 1000;

/// Most points of a cloud, twice those of a megapixel's depth image.
const MAX_POINTS: usize = 1 << 21;

/// Greatest difference of the length of a quaternion from 1.
const UNIT_TOLERANCE: f32 = 1e-3;

/// A place in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Metres.
    pub position: Vec3,
    /// A unit quaternion.
    pub rotation_xyzw: Quat,
}

/// A solid obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Solid {
    /// Its geometry.
    pub shape: Shape,
    /// `world_from_shape`.
    pub place: Place,
}

/// Obstacles that the arm must not hit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Obstacles {
    /// Solids.
    pub solids: Vec<Solid>,
    /// Points of a cloud in the world, metres.
    pub points: Vec<Vec3>,
}

/// From where to where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Configuration of the arm, radians.
    pub start: JointConfig,
    /// `world_from_grip` where it goes.
    pub goal: Place,
    /// Seed of everything drawn.
    pub seed: u32,
}

/// A free path, or why there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The path found.
    Found(FoundPath),
    /// A fixed word: [`lpr_core::path::Rejection::name`].
    Rejected(&'static str),
}

/// A free path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundPath {
    /// The configurations, joined linearly, radians.
    pub path: Vec<JointConfig>,
    /// Length in joint space, radians.
    pub length: f32,
    /// Duration with [`TIMING`], seconds.
    pub seconds: f64,
    /// Samples that the planner drew.
    pub iterations: u32,
}

/// A candidate path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// Which generator made it.
    pub source: &'static str,
    /// True if the arm meets an obstacle or itself on the way.
    pub collides: bool,
    /// Length in joint space, radians.
    pub length: f32,
    /// The configurations, joined linearly, radians.
    pub path: Vec<JointConfig>,
}

/// A draw that gave no candidate.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Rejected {
    /// Which generator failed.
    pub source: &'static str,
    /// Reason: [`lpr_core::path::Rejection::name`].
    pub reason: &'static str,
}

/// A candidate set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidates {
    /// The paths, in the order planner, Bézier.
    pub candidates: Vec<Candidate>,
    /// The draws that gave none.
    pub rejected: Vec<Rejected>,
}

/// An arm among obstacles.
#[derive(Debug)]
pub struct Planner {
    robot: Arc<Robot>,
    arm: ArmSpheres,
    scene: Scene,
}

impl Planner {
    /// The arm called `robot` among `obstacles`; of a cloud, one point for every cube of 1 cm.
    ///
    /// # Errors
    ///
    /// When there is no such robot, an obstacle has no place in the world or no size, or there are
    /// over two million points.
    pub fn new(robot: &str, obstacles: &Obstacles) -> Result<Self> {
        Self::of(Robot::by_name(robot)?, obstacles)
    }

    /// An arm among `obstacles`; of a cloud, one point for every cube of 1 cm.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub(crate) fn of(robot: Arc<Robot>, obstacles: &Obstacles) -> Result<Self> {
        if obstacles.points.len() > MAX_POINTS {
            return Err(Error::Environment(format!(
                "points: at most {MAX_POINTS}, found {}",
                obstacles.points.len()
            )));
        }
        let solids = obstacles.solids.iter().enumerate().map(|(idx, solid)| {
            let has_size = is_finite(&solid.shape);
            let pose = solid.place.pose().filter(|_| has_size);
            let pose = pose.ok_or_else(|| {
                Error::Environment(format!("solids[{idx}]: finite sizes and a pose expected"))
            })?;
            Ok(Primitive::new(&solid.shape, &pose))
        });
        let scene = Scene::from_primitives(solids.collect::<Result<_>>()?);
        let scene = scene.with_points(&downsample(&obstacles.points, VOXEL), POINT_RADIUS);
        let arm = match robot.gripper {
            Some(_) => ArmSpheres::new(&robot),
            None => ArmSpheres::from_description(&robot)?,
        };
        Ok(Self { robot, arm, scene })
    }

    pub(crate) const fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Checker of motions, at that many configurations for each radian.
    pub(crate) const fn checker(&self, checks_per_radian: f32) -> MotionChecker<'_> {
        MotionChecker::new(&self.scene, &self.arm, checks_per_radian)
    }

    /// Up to `n` distinct configurations of the goal, of each the winding nearest the start.
    ///
    /// # Errors
    ///
    /// When start or goal are no numbers of the arm, or over a thousand configurations are asked for.
    pub fn configurations(&self, request: &Request, n: usize) -> Result<Vec<JointConfig>> {
        if n > MAX_CONFIGURATIONS {
            return Err(Error::Config(format!("n: at most {MAX_CONFIGURATIONS}, got {n}")));
        }
        let rng = &mut stream(u64::from(request.seed), Stream::Ik, 0);
        let (start, goal) = (request.start(&self.robot)?, request.goal()?);
        Ok(self.robot.ik_distinct(&goal, n, CANDIDATES.min_goal_distance, &start, rng))
    }

    /// A short free path to one of the goal's configurations.
    ///
    /// # Errors
    ///
    /// When start or goal are no numbers of the arm.
    pub fn plan(&self, request: &Request) -> Result<Outcome> {
        let start = request.start(&self.robot)?;
        let goals = self.configurations(request, CANDIDATES.planner_paths)?;
        let checker = self.checker(PLANNER.checks_per_radian);
        let rng = &mut stream(u64::from(request.seed), Stream::Planner, 0);
        let plan = match rrt_connect(&checker, &start, &goals, &PLANNER, rng) {
            Ok(plan) => plan,
            Err(reason) => return Ok(Outcome::Rejected(reason.name())),
        };
        let timed = TimedPath::new(simplify(&plan.path, &checker), &self.robot, &TIMING)?;
        let (path, length) = (timed.path().configs().to_vec(), timed.path().length());
        Ok(Outcome::Found(FoundPath {
            path,
            length,
            seconds: timed.duration_secs(),
            iterations: plan.iterations,
        }))
    }

    /// The candidate paths to the goal.
    ///
    /// # Errors
    ///
    /// When start or goal are no numbers of the arm.
    pub fn candidates(&self, request: &Request) -> Result<Candidates> {
        let (start, goal) = (request.start(&self.robot)?, request.goal()?);
        let query = PathQuery { robot: &self.robot, start, goal, scene: &self.scene };
        let set = candidates(
            &query,
            &CANDIDATES,
            CandidateStreams { seed: u64::from(request.seed), step: 0 },
        );
        Ok(Candidates {
            candidates: set.candidates.iter().map(Candidate::from).collect(),
            rejected: set.rejected.iter().map(Rejected::from).collect(),
        })
    }
}

impl Request {
    fn start(&self, robot: &Robot) -> Result<JointConfig> {
        let dof = robot.dof();
        let broken = || Error::Config(format!("start: {dof} joints expected, with finite angles"));
        let is_sound = self.start.is_finite() && self.start.dof() == dof;
        is_sound.then_some(self.start).ok_or_else(broken)
    }

    fn goal(&self) -> Result<Pose3> {
        self.goal.pose().ok_or_else(|| {
            Error::Config("goal: a finite position and a unit quaternion expected".to_owned())
        })
    }
}

impl Place {
    fn pose(&self) -> Option<Pose3> {
        let is_unit = (self.rotation_xyzw.length() - 1.0).abs() < UNIT_TOLERANCE;
        (self.position.is_finite() && is_unit)
            .then(|| Pose3::from_parts(self.position, self.rotation_xyzw))
    }
}

impl From<&CandidatePath> for Candidate {
    fn from(CandidatePath { source, path, collides }: &CandidatePath) -> Self {
        Self {
            source: source.name(),
            collides: *collides,
            length: path.length(),
            path: path.configs().to_vec(),
        }
    }
}

impl From<&RejectedPath> for Rejected {
    fn from(RejectedPath { source, reason }: &RejectedPath) -> Self {
        Self { source: source.name(), reason: reason.name() }
    }
}

/// Checks that every number of a shape is finite.
fn is_finite(shape: &Shape) -> bool {
    match shape {
        Shape::Sphere { radius } => radius.is_finite(),
        Shape::Cuboid { half_extents } => half_extents.is_finite(),
        Shape::Cylinder { radius, half_length } | Shape::Capsule { radius, half_length } => {
            radius.is_finite() && half_length.is_finite()
        }
        Shape::Convex { points } => {
            !points.is_empty() && points.iter().all(|point| point.is_finite())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use lpr_core::robot::XARM7;

    fn request() -> Request {
        let goal = Place {
            position: Vec3::new(0.35, 0.4, 0.15),
            rotation_xyzw: Quat::from_rotation_x(PI),
        };
        Request { start: XARM7.start, goal, seed: 3 }
    }

    /// A ball of that radius where the goal is.
    fn ball(radius: f32) -> Obstacles {
        Obstacles {
            solids: vec![Solid { shape: Shape::Sphere { radius }, place: request().goal }],
            points: Vec::new(),
        }
    }

    fn planner(obstacles: &Obstacles) -> Planner {
        Planner::new("xarm7", obstacles).unwrap()
    }

    #[cfg(feature = "page")]
    #[test]
    fn numbers_are_those_of_the_preset() {
        let preset = lpr_core::config::Config::preset("fast").unwrap();
        // A second round of curves needs a ranker.
        let candidates = CandidateSettings { refinement: None, ..preset.candidates };
        assert_eq!((candidates, preset.timing), (CANDIDATES, TIMING));
    }

    #[test]
    fn configurations_reach_the_goal_and_paths_lead_to_it() {
        let planner = planner(&Obstacles::default());
        let configurations = planner.configurations(&request(), 20).unwrap();
        assert_eq!(configurations.len(), 20);
        let is_goal = |config: &JointConfig| {
            XARM7.grip(config).translation.distance(request().goal.position) < 1e-4
        };
        assert!(configurations.iter().all(is_goal));
        let Outcome::Found(found) = planner.plan(&request()).unwrap() else {
            panic!("nothing is in the way")
        };
        assert!(
            found.path[0] == XARM7.start
                && is_goal(found.path.last().unwrap())
                && found.seconds > 0.0
        );
        let set = planner.candidates(&request()).unwrap();
        assert!(set.candidates.iter().all(|candidate| is_goal(candidate.path.last().unwrap())));
        assert!(set.candidates.iter().any(|candidate| candidate.source == "bezier"));
    }

    #[test]
    fn what_stands_at_the_goal_is_in_the_way_as_a_solid_and_as_points() {
        // A row of points across both pads.
        let points =
            (-5..=5_i8).map(|i| request().goal.position + 0.02 * f32::from(i) * Vec3::Y).collect();
        let cloud = Obstacles { points, ..Obstacles::default() };
        for obstacles in [ball(0.05), cloud] {
            assert_eq!(
                planner(&obstacles).plan(&request()).unwrap(),
                Outcome::Rejected("goal_collides")
            );
            let set = planner(&obstacles).candidates(&request()).unwrap();
            assert!(set.candidates.iter().all(|candidate| candidate.collides));
        }
    }

    #[test]
    fn what_cannot_be_is_named() {
        assert!(
            Planner::new("xarm8", &Obstacles::default()).unwrap_err().to_string().contains("xarm8")
        );
        assert!(
            Planner::new("xarm7", &ball(f32::NAN)).unwrap_err().to_string().contains("solids[0]")
        );
        let planner = planner(&ball(0.01));
        let broken = |change: fn(&mut Request)| {
            let mut request = request();
            change(&mut request);
            planner.plan(&request).unwrap_err().to_string()
        };
        assert!(broken(|request| request.start[2] = f32::INFINITY).contains("start"));
        assert!(
            broken(|request| request.start = JointConfig::new([0.0; 4]))
                .contains("7 joints expected")
        );
        assert!(broken(|request| request.goal.position.x = f32::NAN).contains("goal"));
        assert!(
            broken(|request| request.goal.rotation_xyzw = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0))
                .contains("goal")
        );
        assert!(planner.configurations(&request(), 1001).unwrap_err().to_string().contains("1000"));
    }
}
