//! Arms of more joints than the built-in ones: one like a mobile manipulator's with a torso that
//! lifts, and a humanoid's chain of fourteen.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, json};
use lpr_core::glamx::{Pose3, Vec3};
use lpr_core::path::{
    BezierSettings, CandidateSettings, CandidateStreams, GripSpeedLimit, JointPath, MotionLimits,
    PathQuery, PlannerKind, RrtSettings, SmoothPath, Source, candidates, time_optimal,
};
use lpr_core::robot::{JointConfig, JointMotion, MAX_JOINTS, Robot};
use lpr_core::scene::{Primitive, Scene};
use serde_json::{Value, json as value};

/// A joint of the chain: type, where it is in the link before, axis, and limits.
type Row = (&'static str, [f64; 3], [f64; 3], [f64; 2]);

const FREE: [f64; 2] = [0.0, 0.0];

/// A torso that lifts, and seven joints of which three turn without end.
const EIGHT: [Row; 8] = [
    ("prismatic", [0.0, 0.0, 0.4], [0.0, 0.0, 1.0], [0.0, 0.4]),
    ("revolute", [0.1, 0.0, 0.3], [0.0, 0.0, 1.0], [-1.6, 1.6]),
    ("revolute", [0.12, 0.0, 0.06], [0.0, 1.0, 0.0], [-1.2, 1.5]),
    ("continuous", [0.2, 0.0, 0.0], [1.0, 0.0, 0.0], FREE),
    ("revolute", [0.14, 0.0, 0.0], [0.0, 1.0, 0.0], [-2.2, 2.2]),
    ("continuous", [0.2, 0.0, 0.0], [1.0, 0.0, 0.0], FREE),
    ("revolute", [0.12, 0.0, 0.0], [0.0, 1.0, 0.0], [-2.1, 2.1]),
    ("continuous", [0.14, 0.0, 0.0], [1.0, 0.0, 0.0], FREE),
];

/// From hip to hand: joints about the vertical and across it in turns.
fn fourteen() -> Vec<Row> {
    let row = |j: usize| match j % 2 {
        0 => ("revolute", [0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [-1.0, 1.2]),
        _ => ("revolute", [0.0, 0.0, 0.1], [0.0, 1.0, 0.0], [-1.0, 1.3]),
    };
    (0..14).map(row).collect()
}

/// A ball on every link, and a tip 10 cm beyond the last joint.
fn urdf(name: &str, rows: &[Row]) -> String {
    let n = rows.len();
    let ball = r#"<collision><geometry><sphere radius="0.04"/></geometry></collision>"#;
    let links: String = (0..=n).map(|i| format!(r#"<link name="l{i}">{ball}</link>"#)).collect();
    let text = |v: &[f64; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    let joints = rows.iter().enumerate().map(|(i, (kind, origin, axis, [lower, upper]))| {
        let limit = match *kind {
            "continuous" => String::new(),
            _ => format!(r#"<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/>"#),
        };
        format!(
            r#"<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{}"/>
            <origin xyz="{}"/><axis xyz="{}"/>{limit}</joint>"#,
            i + 1,
            text(origin),
            text(axis),
        )
    });
    let joints: String = joints.collect();
    let tip = format!(
        r#"<link name="tip"/><joint name="end" type="fixed"><parent link="l{n}"/><child link="tip"/>
        <origin xyz="{}"/></joint>"#,
        text(&rows[n - 1].2.map(|_| 0.06)),
    );
    format!(r#"<robot name="{name}">{links}{joints}{tip}</robot>"#)
}

fn arms() -> [(usize, String); 2] {
    [(8, urdf("lifter", &EIGHT)), (14, urdf("hip-to-hand", &fourteen()))]
}

fn read(text: &str) -> Robot {
    Robot::from_urdf(text, None, None, &|_| None).unwrap()
}

/// Neither stretched out nor at a limit.
fn bent(robot: &Robot) -> JointConfig {
    JointConfig::from_fn(robot.dof(), |j| {
        let middle = robot.middle()[j];
        middle + if robot.joints[j].motion == JointMotion::Slide { 0.05 } else { 0.25 }
    })
}

#[test]
fn joints_that_slide_and_that_turn_without_end_are_told_apart() {
    let lifter = read(&arms()[0].1);
    assert_eq!(lifter.joints[0].motion, JointMotion::Slide);
    let endless: Vec<bool> = lifter.joints.iter().map(|joint| joint.is_continuous).collect();
    assert_eq!(endless, [false, false, false, true, false, true, false, true]);
    let mut lifted = lifter.start;
    lifted[0] += 0.1;
    let rise = lifter.grip(&lifted).translation - lifter.grip(&lifter.start).translation;
    assert!(rise.distance(Vec3::new(0.0, 0.0, 0.1)) < 1e-6, "{rise}");
}

#[test]
fn candidate_paths_of_arms_with_eight_and_fourteen_joints_lead_to_the_goal() {
    let settings = CandidateSettings {
        path_len: 20,
        planner_paths: 4,
        bezier_paths: 4,
        screw_paths: 1,
        planner_collision_free_fraction: 0.5,
        draws_per_path: 5,
        min_goal_distance: 0.2,
        planner: PlannerKind::RrtConnect,
        rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
        bezier: BezierSettings { sigma: 0.05 },
        refinement: None,
    };
    for (dof, text) in arms() {
        let robot = read(&text);
        let start = bent(&robot);
        let from = robot.grip(&start);
        let goal =
            Pose3::from_parts(from.translation + Vec3::new(-0.05, 0.05, -0.05), from.rotation);
        let beside = Primitive::Sphere { center: Vec3::new(2.0, 2.0, 0.5), radius: 0.1 };
        let scene = Scene::from_primitives(vec![beside]);
        let query = PathQuery { robot: &robot, start, goal, scene: &scene };
        let set = candidates(&query, &settings, CandidateStreams { seed: 0, step: 0 });
        for source in [Source::Planner, Source::Bezier, Source::Screw] {
            let n = set.candidates.iter().filter(|path| path.source == source).count();
            assert!(n > 0, "{dof} joints, {}: {:?}", source.name(), set.rejected);
        }
        for candidate in &set.candidates {
            let configs = candidate.path.configs();
            assert_eq!((configs.len(), configs[0]), (20, start));
            assert!(configs.iter().all(|config| robot.within_limits(config)));
            let end = robot.grip(candidate.path.goal()).translation;
            assert!(end.distance(goal.translation) < 1e-3, "{dof} joints: {end}");
        }
    }
}

#[test]
fn motions_of_arms_with_eight_and_fourteen_joints_keep_the_limits_of_joints_and_grip() {
    for (dof, text) in arms() {
        let robot = read(&text);
        let configs = [robot.start, bent(&robot), robot.start.lerp(&bent(&robot), 0.3)];
        let curve = SmoothPath::<MAX_JOINTS>::through(&JointPath::new(configs.to_vec()).unwrap());
        let limits = MotionLimits {
            velocity: [1.0; MAX_JOINTS],
            acceleration: [5.0; MAX_JOINTS],
            jerk: Some([100.0; MAX_JOINTS]),
        };
        let slow = GripSpeedLimit { robot: &robot, max_speed: 0.2 };
        let free = time_optimal(&curve, &limits, None).unwrap();
        let motion = time_optimal(&curve, &limits, Some(&slow)).unwrap();
        assert!(motion.duration_secs() > free.duration_secs(), "{dof} joints");
        let at = |t| {
            let config = motion.at(t).config();
            robot.grip_f64(&JointConfig::from_fn(dof, |j| config[j])).translation
        };
        let (mut fastest, mut swiftest) = (0.0_f64, 0.0_f64);
        for (t, state) in motion.samples(1e-3).unwrap() {
            assert!(state.velocities.iter().all(|speed| speed.abs() <= 1.0 + 1e-6));
            assert!(state.accelerations.iter().all(|change| change.abs() <= 5.0 + 1e-6));
            assert!(state.angles[dof..].iter().all(|q| *q == 0.0), "joints that are not there");
            let speed = at(t + 5e-3).distance(at(t - 5e-3)) / 1e-2;
            fastest = fastest.max(speed);
            swiftest = state.velocities.iter().fold(swiftest, |most, speed| most.max(speed.abs()));
        }
        // Positions are f32: the difference quotient is that good.
        assert!(fastest <= 0.2 + 1e-3, "{dof} joints: {fastest} m/s");
        assert!(fastest > 0.19 || swiftest > 0.99, "{dof} joints: no limit is used");
    }
}

#[test]
fn the_command_line_plans_and_solves_for_arms_with_eight_and_fourteen_joints() {
    let folder = Folder::new();
    for (dof, text) in arms() {
        let robot = read(&text);
        let arm = folder.write(&format!("{dof}.urdf"), &text);
        let (start, goal) = (robot.start.to_vec(), bent(&robot).to_vec());
        let file = folder.write("configs.json", value!({"configs": [start, goal]}).to_string());
        let poses = json(&["fk", "--robot", &arm, "--configs", &file])["poses"].clone();
        let expected = robot.flange(&bent(&robot)).translation;
        assert!((poses[1]["position"][2].as_f64().unwrap() - expected.z).abs() < 1e-9, "{poses}");

        let file = folder.write("poses.json", value!({"poses": [poses[1]]}).to_string());
        let found = json(&["ik", "--robot", &arm, "--poses", &file, "--solutions", "3"]);
        let solutions = &found["results"][0]["solutions"];
        assert_eq!(solutions.as_array().unwrap().len(), 3, "{found}");
        let file = folder.write("back.json", value!({"configs": solutions}).to_string());
        for pose in json(&["fk", "--robot", &arm, "--configs", &file])["poses"].as_array().unwrap()
        {
            let at: Vec<f64> = serde_json::from_value(pose["position"].clone()).unwrap();
            let apart = (at[0] - expected.x).hypot(at[1] - expected.y).hypot(at[2] - expected.z);
            assert!(apart < 2e-4, "{dof} joints: {pose}");
        }

        // A ball beside the tip: the straight way may be free, the plan has to be.
        let problem = value!({"robot": robot.name, "problems": [
            {"name": "bend", "start": start, "goals": [goal], "spheres": [{"center": [2, 2, 1], "radius": 0.1}]},
        ]});
        let file = folder.write("problems.json", problem.to_string());
        let report = json(&["plan", "--robot", &arm, "--problems", &file]);
        assert_eq!(report["results"][0]["solved"], true, "{report}");
        let path: Vec<Vec<f32>> =
            serde_json::from_value::<Value>(report["results"][0]["path"].clone())
                .and_then(serde_json::from_value)
                .unwrap();
        assert!(path.iter().all(|config| config.len() == dof), "{report}");
    }
}
