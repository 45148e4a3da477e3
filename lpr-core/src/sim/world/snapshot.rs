//! A world as bytes, from which it goes on bit by bit.
//!
//! Sealed, in `postcard`: the version of rapier, the robot and the state. A snapshot is for the
//! program that made it and its like: a recorded episode ([`SceneSpec`](super::SceneSpec) and
//! paths) outlives releases of rapier, this does not.
//!
//! The digest tells damage, not malice: rapier is not made for a state that someone has forged.

use super::World;
use super::fixed::fixed_parts;
use super::gripper::GripperState;
use super::near::Balls;
use super::params::SimParams;
use super::physics::Physics;
use crate::error::{Error, Result};
use crate::robot::{JointConfig, N_LINKS, Robot};
use crate::sealed::Seal;
use crate::sim::scene::SceneSpec;
use rapier3d::prelude::{ImpulseJointHandle, RigidBodyHandle};
use std::sync::Arc;

/// The head of a snapshot.
const SEAL: Seal = Seal { magic: *b"LPRWORLD", version: 2, oldest: 2 };

/// Versions of rapier and names of robots.
type Origin<'a> = (&'a str, &'a str);

/// Stored state of a [`World`], in this order.
type State = (
    SimParams,
    SceneSpec,
    Vec<RigidBodyHandle>,
    Vec<ImpulseJointHandle>,
    [RigidBodyHandle; N_LINKS],
    [RigidBodyHandle; 2],
    GripperState,
    JointConfig,
    Physics,
);

impl World {
    /// This world as bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Snapshot`] when something of the state has no representation.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let Self {
            physics,
            params,
            robot,
            gripper_spec: _,
            spec,
            bodies,
            joints,
            fixed: _,
            balls: _,
            links,
            fingers,
            gripper,
            config,
        } = self;
        let origin: Origin<'_> = (rapier3d::VERSION, &robot.name);
        let state =
            (params, spec.as_ref(), bodies, joints, links, fingers, gripper, config, physics);
        let payload = postcard::to_allocvec(&(origin, state))
            .map_err(|error| Error::Snapshot(error.to_string()))?;
        Ok(SEAL.seal(&payload))
    }

    /// The world that [`Self::to_bytes`] was asked of, with the same `robot`.
    ///
    /// # Errors
    ///
    /// [`Error::Snapshot`] saying which version, rapier or robot it is of, or that it is damaged.
    pub fn from_bytes(bytes: &[u8], robot: &Arc<Robot>) -> Result<Self> {
        let payload = SEAL.open(bytes).map_err(|error| Error::Snapshot(error.to_string()))?;
        let ((rapier, name), state): (Origin<'_>, &[u8]) =
            postcard::take_from_bytes(payload).map_err(|error| unreadable(&error))?;
        if rapier != rapier3d::VERSION {
            return Err(Error::Snapshot(format!(
                "rapier: expected {}, found {rapier}",
                rapier3d::VERSION
            )));
        }
        if name != robot.name {
            return Err(Error::Snapshot(format!(
                "robot: expected `{}`, found `{name}`",
                robot.name
            )));
        }
        let (state, rest) = postcard::take_from_bytes(state).map_err(|error| unreadable(&error))?;
        if !rest.is_empty() {
            return Err(Error::Snapshot(format!("has {} bytes too many", rest.len())));
        }
        Self::of_state(state, robot)
    }

    fn of_state(state: State, robot: &Arc<Robot>) -> Result<Self> {
        let (params, spec, bodies, joints, links, fingers, gripper, config, physics) = state;
        spec.check().map_err(|error| Error::Snapshot(error.to_string()))?;
        let handles = || bodies.iter().chain(&links).chain(&fingers);
        if bodies.len() != spec.bodies.len()
            || !handles().all(|handle| physics.bodies.contains(*handle))
        {
            return Err(Error::Snapshot("its bodies are not those of its scene".to_owned()));
        }
        if config.dof() != robot.dof() {
            return Err(Error::Snapshot(format!(
                "expected {} joints, found {}",
                robot.dof(),
                config.dof()
            )));
        }
        if joints.len() != spec.joints.len()
            || !joints.iter().all(|joint| physics.impulse_joints.contains(*joint))
        {
            return Err(Error::Snapshot("its joints are not those of its scene".to_owned()));
        }
        let fixed = fixed_parts(&spec, &physics, &bodies).into();
        let balls = Balls::new(&physics, &spec, &links, &bodies).into();
        Ok(Self {
            physics,
            params,
            robot: Arc::clone(robot),
            gripper_spec: super::hand_of(robot)?,
            spec: Arc::new(spec),
            bodies,
            joints,
            fixed,
            balls,
            links,
            fingers,
            gripper,
            config,
        })
    }
}

fn unreadable(error: &postcard::Error) -> Error {
    Error::Snapshot(format!("cannot be read: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::{Gripper, PANDA, ROBOTS, XARM7};
    use crate::sim::demonstrating::demonstrate;
    use crate::sim::environment::SimEnvironment;
    use crate::sim::tasks::Task;
    use crate::sim::world::Grasp;
    use glamx::Vec3;
    use proptest::prelude::{any, prop, prop_assert, proptest};
    use std::sync::LazyLock;

    fn environment(task: &str, robot: &Arc<Robot>) -> SimEnvironment {
        let task = Task::by_name(task).expect("a task");
        SimEnvironment::new(&task, robot, 2, &["front"], &SimParams::STANDARD).expect("a scene")
    }

    /// The world after every control step of a demonstration.
    fn frames(task: &str, robot: &Arc<Robot>) -> Vec<World> {
        demonstrate(&mut environment(task, robot), &mut stream(2, Stream::Demo, 0)).frames
    }

    /// A snapshot of a world whose gripper is just closing on something.
    fn snapshot() -> &'static [u8] {
        static SNAPSHOT: LazyLock<Vec<u8>> = LazyLock::new(|| {
            let mut world = environment("take_lid_off_saucepan", &XARM7).world().clone();
            world.command_gripper(Gripper::Close);
            let config = *world.config();
            (0..7).for_each(|_| world.step(&config).expect("a step of an arm that stands still"));
            world.to_bytes().expect("bytes")
        });
        &SNAPSHOT
    }

    fn refusal(bytes: &[u8], robot: &Arc<Robot>) -> String {
        World::from_bytes(bytes, robot).expect_err("refused").to_string()
    }

    /// One step of an arm that goes up at 0.1 m/s and lets go on the way.
    fn lift(world: &mut World, step: usize) {
        if step == 120 {
            world.command_gripper(Gripper::Open);
        }
        let mut grip = world.robot().grip(world.config());
        grip.translation += Vec3::Z * 0.001;
        let config = world.robot().ik_step(&grip, world.config()).unwrap_or(*world.config());
        // What a pull may end in is the same in both worlds.
        let _ = world.step(&config);
    }

    #[test]
    fn a_restored_world_goes_on_bit_for_bit_with_its_grasp() {
        for (task, robot) in ROBOTS
            .into_iter()
            .flat_map(|robot| [("take_lid_off_saucepan", robot), ("open_drawer", robot)])
        {
            let frames = frames(task, robot);
            let held = frames
                .iter()
                .find(|world| world.grasp() != Grasp::Nothing)
                .expect("something is held");
            let mut original = held.clone();
            let mut restored =
                World::from_bytes(&original.to_bytes().expect("bytes"), robot).expect("a world");
            assert_eq!((restored.grasp(), restored.hash()), (original.grasp(), original.hash()));
            for step in 0..200 {
                lift(&mut original, step);
                lift(&mut restored, step);
                assert_eq!(
                    restored.hash(),
                    original.hash(),
                    "{task} with {}: step {step}",
                    robot.name
                );
            }
            assert_eq!(restored.grasp(), original.grasp());
        }
    }

    #[test]
    fn a_restored_world_gives_the_same_bytes() {
        let world = World::from_bytes(snapshot(), &XARM7).expect("a world");
        assert_eq!(world.to_bytes().expect("bytes"), snapshot());
    }

    #[test]
    fn a_grasp_restored_half_way_ends_as_it_would_have() {
        let close = |mut world: World| {
            let config = *world.config();
            (0..200).for_each(|_| world.step(&config).expect("a step of an arm that stands still"));
            world.hash()
        };
        let world = World::from_bytes(snapshot(), &XARM7).expect("a world");
        assert_eq!(
            close(World::from_bytes(snapshot(), &XARM7).expect("a world")),
            close(world.clone())
        );
        assert_ne!(close(world.clone()), world.hash());
    }

    #[test]
    fn what_it_is_not_of_is_named() {
        assert_eq!(refusal(snapshot(), &PANDA), "snapshot: robot: expected `panda`, found `xarm7`");
        let mut other = snapshot().to_vec();
        other[8] = 7;
        assert_eq!(refusal(&other, &XARM7), "snapshot: version: expected 2, found 7");
        assert!(
            refusal(b"PK\x03\x04 something else entirely", &XARM7).contains("expected `LPRWORLD`")
        );
        assert!(refusal(b"LPR", &XARM7).contains("found 3"));
        let payload = postcard::to_allocvec(&("0.35.2", "xarm7")).expect("bytes");
        let error = refusal(&SEAL.seal(&payload), &XARM7);
        assert_eq!(
            error,
            format!("snapshot: rapier: expected {}, found 0.35.2", rapier3d::VERSION)
        );
    }

    #[test]
    fn an_episode_takes_a_snapshot_of_its_own_scene_only() {
        let env = environment("take_lid_off_saucepan", &XARM7);
        let there = env.at_snapshot(snapshot(), 1).expect("its own scene");
        assert_eq!(
            (there.steps_done(), there.world().to_bytes().expect("bytes").as_slice()),
            (1, snapshot())
        );
        let error = environment("reach_target", &XARM7)
            .at_snapshot(snapshot(), 1)
            .expect_err("of another scene")
            .to_string();
        assert!(
            error.contains("another scene") && error.contains("take_lid_off_saucepan"),
            "{error}"
        );
    }

    proptest! {
        #[test]
        fn damage_is_refused(
            place in any::<prop::sample::Index>(),
            flip in 1_u8..,
            cut in any::<prop::sample::Index>(),
        ) {
            let mut flipped = snapshot().to_vec();
            let place = place.index(flipped.len());
            flipped[place] ^= flip;
            prop_assert!(World::from_bytes(&flipped, &XARM7).is_err());
            let cut = cut.index(snapshot().len());
            prop_assert!(World::from_bytes(&snapshot()[..cut], &XARM7).is_err());
        }

        #[test]
        fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            prop_assert!(World::from_bytes(&bytes, &XARM7).is_err());
            prop_assert!(World::from_bytes(&SEAL.seal(&bytes), &XARM7).is_err());
            let origin = postcard::to_allocvec(&(rapier3d::VERSION, "xarm7")).expect("bytes");
            prop_assert!(World::from_bytes(&SEAL.seal(&[origin, bytes].concat()), &XARM7).is_err());
        }
    }
}
