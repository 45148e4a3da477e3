//! The parts of a scene that the page draws, as JSON.

use lpr_core::agent::Agent;
use lpr_core::env::Environment as _;
use lpr_core::glamx::Vec3;
use lpr_core::perception::VoxelBounds;
use lpr_core::scene::Part;
use lpr_core::sim::SimEnvironment;
use serde::Serialize;

/// A scene with its robot. Poses come apart from it, in the order of `items`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneView {
    /// Name of the task.
    pub task: String,
    /// The task in words.
    pub description: String,
    /// Name of the robot.
    pub robot: String,
    /// Name of the agent's method.
    pub method: &'static str,
    /// Seed of the scene.
    pub seed: u64,
    /// Bodies of the scene, then links, hand and fingers of the robot.
    pub items: Vec<Item>,
    /// Number of items that are the robot's: the last ones.
    pub n_robot_items: usize,
    /// Lower and upper corner of what the agent looks at, metres.
    pub workspace: [Vec3; 2],
}

/// Something that moves as one piece.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Item {
    /// Name.
    pub name: String,
    /// Its geometry, in its own frame.
    pub parts: Vec<Part>,
}

impl SceneView {
    /// The scene of an environment, for the page of `agent`.
    #[must_use]
    pub fn new(environment: &SimEnvironment, seed: u64, agent: &Agent) -> Self {
        let world = environment.world();
        let scene = world
            .spec()
            .bodies
            .iter()
            .map(|body| Item { name: body.name.clone(), parts: body.parts.clone() });
        let robot = world.robot_items();
        let n_robot_items = robot.len();
        let robot = robot
            .into_iter()
            .enumerate()
            .map(|(idx, (_, parts))| Item { name: format!("robot {idx}"), parts });
        let bounds =
            VoxelBounds::scene(environment.robot()).expect("a simulated arm has a workspace");
        Self {
            task: environment.task().name.clone(),
            description: environment.task().describe(environment.variation()),
            robot: environment.robot().name.clone(),
            method: agent.method().name(),
            seed,
            items: scene.chain(robot).collect(),
            n_robot_items,
            workspace: [bounds.min, bounds.max()],
        }
    }
}
