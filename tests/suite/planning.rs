//! Planning and kinematics on the command line: built-in arms and arms in files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, json, refusal};
use lpr_core::robot::XARM7;
use serde_json::{Value, json as value};

/// Three joints that turn about the vertical, 0.4 m apart, with a ball at every joint and at the
/// tip.
const PLANAR_ARM: &str = r#"<robot name="planar">
  <link name="base"/>
  <link name="upper"><collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="lower"><collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="wrist"><collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
  <joint name="j3" type="revolute"><parent link="lower"/><child link="wrist"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
  <joint name="j4" type="fixed"><parent link="wrist"/><child link="tool"/><origin xyz="0.2 0 0"/></joint>
</robot>"#;

/// A start beside a post, with the goal on its other side.
fn around_a_post() -> Value {
    value!({
        "name": "post",
        "start": [-0.8, 0.2, 0, 1.0, 0, 1.2, 0],
        "goals": [[0.8, 0.2, 0, 1.0, 0, 1.2, 0]],
        "capsules": [{"a": [0.45, 0, 0], "b": [0.45, 0, 0.6], "radius": 0.03}],
        "cuboids": [{"center": [0.4, 0, -0.05], "rotation_xyzw": [0, 0, 0, 1], "half_extents": [0.1, 0.1, 0.04]}],
        "spheres": [{"center": [0, 0.9, 0.9], "radius": 0.1}],
        "cylinders": [{"center": [-0.6, 0, 0.3], "rotation_xyzw": [0, 0, 0, 1], "radius": 0.1, "half_length": 0.3}],
        "points": [[0.45, 0.0, 0.62]],
        "point_radius": 0.02,
    })
}

fn plan(folder: &Folder, problems: &[Value], options: &[&str]) -> Value {
    let file =
        folder.write("problems.json", value!({"robot": "xarm7", "problems": problems}).to_string());
    let mut report = json(&[&["plan", "--problems", &file], options].concat());
    for result in report["results"].as_array_mut().unwrap() {
        for key in ["planning_micros", "simplify_micros", "world_micros"] {
            assert!(result[key].as_f64().is_none_or(|micros| micros > 0.0));
            result.as_object_mut().unwrap().remove(key);
        }
    }
    report
}

#[test]
fn a_plan_leads_around_a_post_and_is_shorter_simplified() {
    let folder = Folder::new();
    let report = plan(&folder, &[around_a_post()], &["--repeats", "2"]);
    let result = &report["results"][0];
    assert_eq!(result["solved"], true, "{report}");
    assert_eq!((&result["planner"], &result["reason"]), (&value!("rrt-connect"), &Value::Null));
    assert!(result["checks"].as_u64().unwrap() > 8 && result["iterations"].as_u64().unwrap() > 0);
    let path = result["path"].as_array().unwrap();
    assert!(path.len() > 2, "the straight way is blocked");
    for (end, expected) in
        [(0, &around_a_post()["start"]), (path.len() - 1, &around_a_post()["goals"][0])]
    {
        for (found, expected) in
            path[end].as_array().unwrap().iter().zip(expected.as_array().unwrap())
        {
            assert!((found.as_f64().unwrap() - expected.as_f64().unwrap()).abs() < 1e-6);
        }
    }
    let again = plan(&folder, &[around_a_post()], &[]);
    assert_eq!(again["results"], report["results"], "the same seed");
    let simple = plan(&folder, &[around_a_post()], &["--simplify"]);
    assert!(simple["results"][0]["cost"].as_f64().unwrap() <= result["cost"].as_f64().unwrap());
    assert_eq!(simple["summary"]["solved"], 1);
    assert!(
        simple["summary"]["median_micros"].as_f64()
            <= simple["summary"]["median_total_micros"].as_f64()
    );
}

#[test]
fn problems_that_none_can_solve_say_why() {
    let with = |name: &str, key: &str, replaced: Value| {
        let mut problem = around_a_post();
        problem["name"] = name.into();
        problem[key] = replaced;
        problem
    };
    let inside = value!([0.0, 0.2, 0, 1.0, 0, 1.2, 0]);
    let far = value!([0.0, 9.0, 0, 1.0, 0, 1.2, 0]);
    let problems = [
        with("start_collides", "start", inside.clone()),
        with("goal_collides", "goals", value!([inside])),
        with("outside_limits", "goals", value!([far])),
        with("outside_limits", "start", far),
        with("unreachable", "goals", value!([])),
    ];
    let report = plan(&Folder::new(), &problems, &[]);
    for result in report["results"].as_array().unwrap() {
        assert_eq!((&result["solved"], &result["path"]), (&value!(false), &Value::Null));
        assert_eq!(result["reason"], result["name"]);
    }
    assert_eq!(
        (&report["summary"]["solved"], &report["summary"]["invalid"]),
        (&value!(0), &value!(4))
    );
}

/// Problem sets round pi in other places than descriptions do.
#[test]
fn ends_beyond_a_limit_by_rounding_are_at_the_limit() {
    let limit = f64::from(XARM7.joints[6].upper);
    let beyond = |by: f64| value!([-0.8, 0.2, 0, 1.0, 0, 1.2, limit + by]);
    let mut problem = value!({"name": "p", "start": beyond(3e-6), "goals": [beyond(9e-5)]});
    let result = &plan(&Folder::new(), &[problem.clone()], &[])["results"][0];
    assert_eq!(result["solved"], true, "{result}");
    for end in result["path"].as_array().unwrap() {
        assert_eq!(end[6].as_f64().unwrap() as f32, XARM7.joints[6].upper);
    }
    problem["goals"] = value!([beyond(2e-4)]);
    let result = &plan(&Folder::new(), &[problem], &[])["results"][0];
    assert_eq!(result["reason"], "outside_limits");
}

#[test]
fn a_world_may_be_empty_and_a_file_without_problems() {
    let problem = value!({"name": "nothing", "start": [-0.8, 0.2, 0, 1.0, 0, 1.2, 0], "goals": [[0.8, 0.2, 0, 1.0, 0, 1.2, 0]]});
    for planner in ["rrt-connect", "sbl", "kpiece", "trajopt", "stomp"] {
        let report = plan(
            &Folder::new(),
            std::slice::from_ref(&problem),
            &["--planner", planner, "--simplify"],
        );
        let result = &report["results"][0];
        assert_eq!(
            (&result["solved"], &result["iterations"]),
            (&value!(true), &value!(0)),
            "{report}"
        );
        assert_eq!(result["path"].as_array().unwrap().len(), 2, "straight there");
    }
    let report = plan(&Folder::new(), &[], &[]);
    assert_eq!(
        (&report["results"], &report["summary"]["median_micros"]),
        (&value!([]), &Value::Null)
    );
}

#[test]
fn a_world_of_a_million_points_is_planned_in() {
    // A wall a metre long and high with a point every millimetre; the post stands in it.
    let mut problem = around_a_post();
    let points = (0..1_000_000)
        .map(|i| value!([0.6, f64::from(i % 1000) * 1e-3 - 0.5, f64::from(i / 1000) * 1e-3]));
    problem["points"] = points.collect();
    problem["point_radius"] = value!(0.001);
    let report = plan(&Folder::new(), &[problem], &[]);
    assert_eq!(report["results"][0]["solved"], true, "{report}");
}

#[test]
fn an_arm_in_a_file_has_kinematics_and_plans() {
    let folder = Folder::new();
    let arm = folder.write("planar.urdf", PLANAR_ARM);
    let configs = folder
        .write("configs.json", r#"{"configs": [[0, 0, 0], [1.5707963, 0, 0], [0, 1.5707963, 0]]}"#);
    let poses = json(&["fk", "--robot", &arm, "--configs", &configs]);
    for (pose, expected) in
        poses["poses"].as_array().unwrap().iter().zip([[1.0, 0.0], [0.0, 1.0], [0.4, 0.6]])
    {
        for (axis, expected) in [(0, expected[0]), (1, expected[1]), (2, 0.5)] {
            assert!((pose["position"][axis].as_f64().unwrap() - expected).abs() < 1e-6, "{pose}");
        }
    }
    let file = folder.write("poses.json", value!({"poses": [poses["poses"][2]]}).to_string());
    let found = json(&["ik", "--robot", &arm, "--poses", &file, "--solutions", "2"]);
    let solutions = &found["results"][0]["solutions"];
    assert_eq!(solutions.as_array().unwrap().len(), 2, "elbow left and right: {found}");
    let file = folder.write("back.json", value!({"configs": solutions}).to_string());
    for pose in json(&["fk", "--robot", &arm, "--configs", &file])["poses"].as_array().unwrap() {
        assert!((pose["position"][0].as_f64().unwrap() - 0.4).abs() < 2e-4, "{pose}");
    }
    let problem = value!({"robot": "planar", "problems": [
        {"name": "turn", "start": [-1, 0, 0], "goals": [[1, 0, 0]], "spheres": [{"center": [0.8, 0, 0.5], "radius": 0.1}]},
    ]});
    let file = folder.write("planar.json", problem.to_string());
    let report = json(&["plan", "--robot", &arm, "--problems", &file]);
    assert_eq!(report["results"][0]["solved"], true, "{report}");
    assert_eq!(report["results"][0]["path"][0].as_array().unwrap().len(), 3);
}

#[test]
fn a_description_with_the_closed_form_of_a_built_in_arm_has_it_with_its_own_limits() {
    // The Panda's frames as its vendor rounds them; the second joint is free to one side only.
    let joints = [
        ("0 0 0.333", "0 0 0", -2.9),
        ("0 0 0", "-1.5708 0 0", 0.0),
        ("0 -0.316 0", "1.5708 0 0", -2.9),
        ("0.0825 0 0", "1.5708 0 0", -3.0),
        ("-0.0825 0.384 0", "-1.5708 0 0", -2.9),
        ("0 0 0", "1.5708 0 0", -0.1),
        ("0.088 0 0", "1.5708 0 0", -2.9),
    ];
    let links: String = (0..9).map(|i| format!(r#"<link name="link{i}"/>"#)).collect();
    let joints = joints.iter().enumerate().map(|(i, (xyz, rpy, lower))| {
        format!(
            r#"<joint name="j{i}" type="revolute"><parent link="link{i}"/><child link="link{}"/><origin xyz="{xyz}" rpy="{rpy}"/>
            <axis xyz="0 0 1"/><limit lower="{lower}" upper="{}" velocity="2" effort="9"/></joint>"#,
            i + 1,
            if i == 3 { 0.0 } else { 2.9 },
        )
    });
    let joints: String = joints.collect();
    let flange = r#"<joint name="j8" type="fixed"><parent link="link7"/><child link="link8"/><origin xyz="0 0 0.107"/></joint>"#;
    let folder = Folder::new();
    let arm = folder.write(
        "arm.urdf",
        format!(r#"<robot name="like-a-panda">{links}{joints}{flange}</robot>"#),
    );
    let poses = folder.write(
        "poses.json",
        r#"{"poses": [{"position": [0.45, 0.1, 0.5], "rotation_xyzw": [1, 0, 0, 0]}]}"#,
    );
    let solutions = |robot: &str| {
        json(&["ik", "--robot", robot, "--poses", &poses, "--solutions", "20"])["results"][0]["solutions"].clone()
    };
    let (built_in, described) = (solutions("panda"), solutions(&arm));
    let is_on_its_side = |config: &Value| config[1].as_f64().unwrap() >= 0.0;
    assert_eq!((built_in.as_array().unwrap().len(), described.as_array().unwrap().len()), (20, 20));
    assert!(!built_in.as_array().unwrap().iter().all(is_on_its_side));
    assert!(described.as_array().unwrap().iter().all(is_on_its_side), "{described}");
}

#[test]
fn files_for_planning_are_refused_by_their_field() {
    let folder = Folder::new();
    let refused = |problem: Value| {
        let file =
            folder.write("a.json", value!({"robot": "xarm7", "problems": [problem]}).to_string());
        let error = refusal(&["plan", "--problems", &file], 1);
        error.strip_prefix(&format!("{file}: ")).unwrap_or_else(|| panic!("{error}")).to_owned()
    };
    let with = |key: &str, replaced: Value| {
        let mut problem = around_a_post();
        problem[key] = replaced;
        refused(problem)
    };
    let other_arm = folder.write("b.json", r#"{"robot": "panda", "problems": []}"#);
    assert!(
        refusal(&["plan", "--problems", &other_arm], 1)
            .contains("b.json: robot: is panda, --robot is xarm7")
    );
    let unit = value!([0, 0, 0, 1]);
    for (error, says) in [
        (with("start", value!([0, 0])), "problems[0].start: has 2 joint angles, xarm7 has 7"),
        (
            with("goals", value!([[0, 0, 0, 0, 0, 0, 0], []])),
            "problems[0].goals[1]: has 0 joint angles",
        ),
        (with("start", value!([0, 0, 0, 1e39, 0, 0, 0])), "problems[0].start[3]"),
        (
            with("spheres", value!([{"center": [0, 0, 0], "radius": -1}])),
            "problems[0].spheres[0].radius: is -1",
        ),
        (
            with("capsules", value!([{"a": [0, 0, 1e39], "b": [0, 0, 0], "radius": 1}])),
            "problems[0].capsules[0].a",
        ),
        (
            with(
                "cuboids",
                value!([{"center": [0, 0, 0], "rotation_xyzw": [0, 0, 0, 2], "half_extents": [1, 1, 1]}]),
            ),
            "problems[0].cuboids[0].rotation_xyzw: has norm 2",
        ),
        (
            with(
                "cylinders",
                value!([{"center": [0, 0, 0], "rotation_xyzw": unit, "radius": 1, "half_length": -2}]),
            ),
            "problems[0].cylinders[0].half_length: is -2",
        ),
        (with("point_radius", value!(-0.1)), "problems[0].point_radius: is -0.1"),
        (with("walls", value!([])), "problems[0].walls: unknown field"),
    ] {
        assert!(error.contains(says), "{error} instead of {says}");
    }
}

#[test]
fn descriptions_that_are_broken_or_do_not_go_with_the_arm_are_refused() {
    let folder = Folder::new();
    let configs = folder.write("a.json", r#"{"configs": []}"#);
    let refused = |urdf: &str| {
        let file = folder.write("a.urdf", urdf);
        refusal(&["fk", "--robot", &file, "--configs", &configs], 1)
    };
    for (urdf, says) in [
        (PLANAR_ARM.replace(r#"<parent link="upper"/>"#, r#"<parent link="arm"/>"#), "arm"),
        (PLANAR_ARM.replace(r#"<sphere radius="0.05"/>"#, r#"<teapot radius="0.05"/>"#), "teapot"),
        (PLANAR_ARM.replace(r#"lower="-3""#, r#"lower="NaN""#), "lower"),
        (PLANAR_ARM[..PLANAR_ARM.len() - 8].to_owned(), "URDF"),
    ] {
        let error = refused(&urdf);
        assert!(error.contains(says) && error.contains("a.urdf"), "{error} instead of {says}");
    }
    let without_mesh = PLANAR_ARM
        .replace(r#"<sphere radius="0.05"/>"#, r#"<mesh filename="package://planar/none.stl"/>"#);
    let file = folder.write("a.urdf", without_mesh);
    let error = refusal(&["plan", "--robot", &file, "--problems", &configs], 1);
    assert!(error.contains("none.stl") && error.contains("a.urdf"), "{error}");
    let srdf = ["fk", "--robot", "panda", "--srdf", "a.srdf", "--configs", &configs];
    assert!(refusal(&srdf, 2).contains("--srdf: only for a URDF file"));
    let planner = ["plan", "--problems", &configs, "--planner", "guess"];
    assert!(refusal(&planner, 2).contains("guess"));
    for (option, value, says) in
        [("--range", "0", "from 0.001 to 100"), ("--checks-per-radian", "inf", "from 1 to 10000")]
    {
        assert!(refusal(&["plan", "--problems", &configs, option, value], 2).contains(says));
    }
}

#[test]
fn a_path_is_timed_under_the_names_of_a_ros_trajectory() {
    let folder = Folder::new();
    let report = plan(
        &folder,
        &[around_a_post(), around_a_post()],
        &["--simplify", "--timed", &folder.at("timed"), "--period", "0.02"],
    );
    let result = &report["results"][1];
    let duration = result["timed"]["duration_secs"].as_f64().expect("it is timed");
    assert_eq!(result["timed"]["file"], "0001_post");
    let read = |name: &str| std::fs::read_to_string(folder.at(name)).unwrap();
    let trajectory: Value = serde_json::from_str(&read("timed/0001_post.json")).unwrap();
    let names: Vec<&str> = trajectory["joint_names"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it.as_str().unwrap())
        .collect();
    assert_eq!(names, ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7"]);

    let points = trajectory["points"].as_array().unwrap();
    let row = |point: &Value, field: &str| -> Vec<f64> {
        point[field].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect()
    };
    let secs = |point: &Value| {
        let time = &point["time_from_start"];
        time["sec"].as_f64().unwrap() + 1e-9 * time["nanosec"].as_f64().unwrap()
    };
    assert!((secs(&points[points.len() - 1]) - duration).abs() < 1e-8);
    for (end, config) in [(0, 0), (points.len() - 1, result["path"].as_array().unwrap().len() - 1)]
    {
        for (j, angle) in row(&points[end], "positions").iter().enumerate() {
            let wanted = result["path"][config][j].as_f64().unwrap();
            assert!((angle - wanted).abs() < 1e-5, "joint {j}: {angle} for {wanted}");
        }
        assert!(row(&points[end], "velocities").iter().all(|speed| speed.abs() < 1e-6));
    }
    // Positions are those of the velocities, which the arm's limits bound.
    for pair in points.windows(2) {
        let dt = secs(&pair[1]) - secs(&pair[0]);
        let [before, after] =
            [0, 1].map(|i| [row(&pair[i], "positions"), row(&pair[i], "velocities")]);
        for (j, joint) in XARM7.joints.iter().enumerate() {
            let most = f64::from(joint.max_acceleration) * 1.001;
            let moved = after[0][j] - before[0][j];
            let mean = 0.5 * (before[1][j] + after[1][j]);
            assert!(
                (moved - mean * dt).abs() < 0.25 * most * dt * dt + 1e-6,
                "joint {j}: {pair:?}"
            );
            assert!((after[1][j] - before[1][j]).abs() < most * dt + 1e-6, "joint {j}: {pair:?}");
            assert!(after[1][j].abs() < f64::from(joint.max_velocity) * 1.001);
            assert!(row(&pair[0], "accelerations")[j].abs() < most);
        }
    }

    let csv = read("timed/0001_post.csv");
    let mut lines = csv.lines();
    let head = lines.next().unwrap();
    assert!(head.starts_with(r#"time_from_start,"positions.joint1","positions.joint2""#), "{head}");
    assert!(head.ends_with(r#""accelerations.joint7""#), "{head}");
    let second: Vec<f64> =
        lines.nth(1).unwrap().split(',').map(|value| value.parse().unwrap()).collect();
    assert_eq!(second.len(), 22);
    assert_eq!(second[1..8], row(&points[1], "positions")[..]);

    let again = folder.at("problems.json");
    let arguments = ["plan", "--problems", &again, "--timed", &folder.at("timed")];
    assert!(refusal(&arguments, 1).contains("timed"), "an old result stays");
}

#[test]
fn what_the_tip_carries_must_not_touch_anything_either() {
    let folder = Folder::new();
    // Level with the tip, 30 cm beyond it.
    let problem = |attached: Value| {
        value!({"name": "stick", "start": [0, 0, 0], "goals": [[0.5, 0, 0]],
            "spheres": [{"center": [1.3, 0, 0.5], "radius": 0.02}], "attached": attached})
    };
    let stick = value!({"cuboids": [{"center": [0.15, 0, 0], "rotation_xyzw": [0, 0, 0, 1], "half_extents": [0.2, 0.01, 0.01]}], "touching": ["wrist"]});
    let half = core::f64::consts::FRAC_1_SQRT_2;
    let rod = value!({"cylinders": [{"center": [0.15, 0, 0], "rotation_xyzw": [0, half, 0, half], "radius": 0.01, "half_length": 0.2}], "touching": ["wrist"]});
    let finger = value!({"capsules": [{"a": [0.05, 0, 0], "b": [0.35, 0, 0], "radius": 0.01}], "touching": ["wrist"]});
    let beads = value!({"spheres": [{"center": [0.3, 0, 0], "radius": 0.03}]});
    let short = value!({"capsules": [{"a": [0.05, 0, 0], "b": [0.15, 0, 0], "radius": 0.01}], "touching": ["wrist"]});
    let arm = folder.write("planar.urdf", PLANAR_ARM);
    let planned = |attached: &Value| {
        let file = value!({"robot": "planar", "problems": [problem(attached.clone())]});
        let file = folder.write("held.json", file.to_string());
        json(&["plan", "--robot", &arm, "--problems", &file])["results"][0].clone()
    };
    for attached in [&stick, &rod, &finger, &beads] {
        let result = planned(attached);
        assert_eq!(result["reason"], "start_collides", "{result}");
        let contact = result["contact"].as_str().unwrap();
        assert!(contact.starts_with("link attached and the sphere at 1.300"), "{contact}");
    }
    assert_eq!(planned(&short)["solved"], true);

    let refused = |attached: Value| {
        let file = value!({"robot": "planar", "problems": [problem(attached)]});
        let file = folder.write("held.json", file.to_string());
        refusal(&["plan", "--robot", &arm, "--problems", &file], 1)
    };
    let error =
        refused(value!({"spheres": [{"center": [0, 0, 0], "radius": 1}], "touching": ["hand"]}));
    assert!(error.contains("problems[0].attached.touching") && error.contains("hand"), "{error}");
    let error = refused(value!({"spheres": [{"center": [0, 0, 0], "radius": -1}]}));
    assert!(error.contains("problems[0].attached.spheres[0].radius: is -1"), "{error}");
}
