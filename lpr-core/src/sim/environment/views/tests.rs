//! Images on demand against the observation, the scene's geometry, and themselves.

use super::*;
use crate::env::Environment as _;
use crate::perception::{CAMERA_NAMES, DepthNoise, Observation};
use crate::robot::{PANDA, XARM7};
use crate::scene::Part;
use crate::sim::observing::render::NO_ITEM;
use crate::sim::observing::{MaskLabel, Randomization};
use crate::sim::tasks::Task;
use crate::sim::world::{SimParams, collider_pose, shared_shape};
use glamx::Vec3;

const ALL: [Channel; 4] = [Channel::Rgb, Channel::Depth, Channel::Cloud, Channel::Mask];
const NOISY: Sensing =
    Sensing { noise: DepthNoise::STRUCTURED_LIGHT, randomization: Randomization::MODERATE };

fn environment(task: &str) -> SimEnvironment {
    let task = Task::by_name(task).expect("a task");
    SimEnvironment::new(&task, &XARM7, 3, &CAMERA_NAMES, &SimParams::STANDARD).expect("a scene")
}

fn request(camera: &str, size: [usize; 2], channels: &[Channel]) -> CameraRequest {
    CameraRequest { camera: camera.to_owned(), size, channels: channels.to_vec() }
}

/// All that every camera sees at the size of observations.
fn everything(env: &mut SimEnvironment) -> Vec<Capture> {
    env.frames(&CAMERA_NAMES.map(|name| request(name, [128, 128], &ALL))).expect("built-in cameras")
}

fn assert_same(observation: &Observation, captures: &[Capture]) {
    assert_eq!(observation.views.len(), captures.len());
    for (View { camera, rgb, depth, points }, capture) in observation.views.iter().zip(captures) {
        assert_eq!(capture.camera, *camera);
        assert_eq!(
            (&capture.rgb, &capture.depth),
            (&Some(rgb.clone()), &Some(depth.clone())),
            "{}",
            camera.name
        );
        assert_eq!(capture.points, Some(points.clone()), "{}", camera.name);
    }
}

#[test]
fn every_channel_is_that_of_the_observation_bit_for_bit() {
    let mut env = environment("stack_wine");
    let captures = everything(&mut env);
    assert_same(&env.observe(), &captures);
    env.set_sensing(NOISY, 5);
    let captures = everything(&mut env);
    assert_same(&env.observe(), &captures);
}

#[test]
fn nothing_is_made_that_is_not_asked_for() {
    let mut env = environment("open_drawer");
    let whole = &everything(&mut env)[0];
    for channel in ALL {
        let one = &env.frames(&[request("front", [128, 128], &[channel])]).expect("a camera")[0];
        let expected = Capture {
            camera: whole.camera.clone(),
            rgb: whole.rgb.clone().filter(|_| channel == Channel::Rgb),
            depth: whole.depth.clone().filter(|_| channel == Channel::Depth),
            points: whole.points.clone().filter(|_| channel == Channel::Cloud),
            mask: whole.mask.clone().filter(|_| channel == Channel::Mask),
        };
        assert_eq!(*one, expected, "{channel:?}");
    }
    assert_eq!(env.frames(&[]), Ok(Vec::new()));
    let none = &env.frames(&[request("front", [8, 8], &[])]).expect("a camera")[0];
    assert!(
        none.rgb.is_none() && none.depth.is_none() && none.points.is_none() && none.mask.is_none()
    );
}

#[test]
fn images_have_any_size() {
    let mut env = environment("pick_up_cup");
    for size in [[1, 1], [61, 43], [320, 180]] {
        let capture = &env.frames(&[request("wrist", size, &ALL)]).expect("a camera")[0];
        let n_pixels = size[0] * size[1];
        assert_eq!([capture.camera.width, capture.camera.height], size);
        assert_eq!(capture.depth.as_ref().map(Vec::len), Some(n_pixels));
        assert_eq!(capture.mask.as_ref().map(Vec::len), Some(n_pixels));
    }
}

#[test]
fn an_unknown_camera_is_an_error_that_names_the_known_ones() {
    let error = environment("reach_target")
        .frames(&[request("rear", [8, 8], &ALL)])
        .expect_err("no such camera")
        .to_string();
    assert!(error.contains("'rear'") && error.contains("overhead"), "{error}");
}

/// Distance of a point from the nearest of `parts`, metres.
fn distance(parts: &[Part], world_from_body: Pose3, point: Vec3) -> f32 {
    let to_part = |part: &Part| {
        let world_from_shape = world_from_body * collider_pose(part);
        shared_shape(&part.shape).distance_to_point(&world_from_shape, point, true)
    };
    parts.iter().map(to_part).fold(f32::INFINITY, f32::min)
}

#[test]
fn every_pixel_of_a_body_lies_on_that_body() {
    for task in ["stack_wine", "open_drawer", "take_lid_off_saucepan"] {
        let mut env = environment(task);
        for capture in everything(&mut env) {
            let (points, mask) =
                (capture.points.expect("asked for"), capture.mask.expect("asked for"));
            let robot = env.world().robot_items();
            for (point, value) in points.into_iter().zip(mask) {
                let bodies = &env.world().spec().bodies;
                match MaskLabel::of(env.world(), value).expect("a value of a mask") {
                    MaskLabel::Nothing => assert_eq!(point, Vec3::INFINITY),
                    MaskLabel::Body { body, name } => {
                        assert_eq!(bodies[body].name, name);
                        // Meshes of round shapes lie a little inside.
                        let distance =
                            distance(&bodies[body].parts, env.world().body_pose(body), point);
                        assert!(distance < 1e-3, "{task}: {distance} m from {name}");
                    }
                    MaskLabel::Robot { part } => {
                        let (pose, parts) = &robot[usize::from(value) - 1 - bodies.len()];
                        let distance = distance(parts, *pose, point);
                        assert!(distance < 1e-3, "{task}: {distance} m from {part}");
                    }
                }
            }
        }
    }
}

#[test]
fn values_of_a_mask_have_names_and_others_have_none() {
    let env = environment("take_lid_off_saucepan");
    let world = env.world();
    let n_bodies = world.spec().bodies.len() as u16;
    assert_eq!(MaskLabel::of(world, NO_ITEM), Some(MaskLabel::Nothing));
    assert_eq!(
        MaskLabel::of(world, n_bodies),
        Some(MaskLabel::Body { body: usize::from(n_bodies) - 1, name: "table" })
    );
    assert_eq!(MaskLabel::of(world, n_bodies + 1), Some(MaskLabel::Robot { part: "base" }));
    let n_frames = world.robot_items().len() as u16;
    assert_eq!(
        MaskLabel::of(world, n_bodies + n_frames),
        Some(MaskLabel::Robot { part: "finger" })
    );
    assert_eq!(MaskLabel::of(world, n_bodies + n_frames + 1), None);
}

#[test]
fn sensing_that_is_all_off_changes_no_bit() {
    let mut env = environment("phone_on_base");
    let truth = env.observe();
    env.set_sensing(Sensing { noise: DepthNoise::OFF, randomization: Randomization::OFF }, 9);
    assert_eq!(env.observe(), truth);
}

#[test]
fn the_same_seed_and_step_look_the_same_and_others_do_not() {
    let mut env = environment("reach_target");
    env.set_sensing(NOISY, 1);
    let first = env.observe();
    assert_eq!(env.observe(), first, "looking changes nothing");
    let depth = |env: &mut SimEnvironment| env.observe().views[0].depth.clone();
    assert_ne!(depth(&mut env.at(env.world().clone(), 1)), first.views[0].depth);
    env.set_sensing(NOISY, 2);
    assert_ne!(env.observe().views[0].rgb, first.views[0].rgb);
    env.set_sensing(NOISY, 1);
    assert_eq!(env.observe(), first);
}

#[test]
fn noise_of_one_camera_does_not_depend_on_the_others() {
    let mut env = environment("open_box");
    env.set_sensing(NOISY, 1);
    let all = everything(&mut env);
    let one = env.frames(&[request("wrist", [128, 128], &ALL)]).expect("a camera");
    let wrist = CAMERA_NAMES.iter().position(|name| *name == "wrist").expect("a camera");
    assert_eq!(one[0], all[wrist]);
    assert_ne!(all[0].depth, all[wrist].depth);
}

#[test]
fn a_reset_keeps_the_settings_and_takes_the_seed_of_the_scene() {
    let mut env = environment("close_box");
    env.set_sensing(NOISY, 1);
    env.reset(4).expect("a scene");
    assert_eq!(env.sensing(), Some(&NOISY));
    let seen = env.observe();
    env.set_sensing(NOISY, 4);
    assert_eq!(env.observe(), seen);
    let mut plain = environment("close_box");
    plain.reset(4).expect("a scene");
    assert_eq!(plain.sensing(), None);
    assert_ne!(plain.observe(), seen);
}

#[test]
fn a_noisy_cloud_is_the_noisy_depth_seen_from_where_the_camera_stands() {
    for robot in [&XARM7, &PANDA] {
        let task = Task::by_name("stack_wine").expect("a task");
        let mut env = SimEnvironment::new(&task, robot, 3, &["front"], &SimParams::STANDARD)
            .expect("a scene");
        let still = env.observe().views[0].camera.clone();
        env.set_sensing(NOISY, 6);
        let View { camera, depth, points, .. } = env.observe().views.remove(0);
        assert_ne!(camera.world_from_camera, still.world_from_camera);
        for (idx, (depth, point)) in depth.into_iter().zip(points).enumerate() {
            assert_eq!(depth.is_finite(), point.is_finite());
            if let Some((image, z)) = camera.project(point).filter(|_| depth.is_finite()) {
                assert!((z - depth).abs() < 1e-5, "pixel {idx}: {z} for {depth}");
                let center = [(idx % camera.width) as f32 + 0.5, (idx / camera.width) as f32 + 0.5];
                assert!(
                    (image.to_array()[0] - center[0]).abs() < 1e-2
                        && (image.to_array()[1] - center[1]).abs() < 1e-2
                );
            }
        }
    }
}
