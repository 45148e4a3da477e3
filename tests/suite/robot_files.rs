//! Robot descriptions as they are found: each test is named after what went wrong with a file.

use crate::lpr::{Folder, command, json, refusal, refusal_of, table, text};
use serde_json::{Value, json as value};

/// A link with a ball at x 0.3 that turns about z without end.
const TURNTABLE: &str = r#"<robot name="turntable"><link name="base"/>
  <link name="arm"><collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1"/></joint></robot>"#;

/// A link with a mesh that turns.
fn with_mesh(file: &str) -> String {
    format!(
        r#"<robot name="r"><link name="base"/>
        <link name="arm"><collision><geometry><mesh filename="{file}"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1"/></joint></robot>"#
    )
}

const TETRAHEDRON: &str =
    "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// The result of one problem.
fn plan(folder: &Folder, arm: &[&str], start: &Value, goal: &Value, balls: &Value) -> Value {
    let problem = value!({"name": "p", "start": start, "goals": [goal], "spheres": balls});
    let problems =
        folder.write("problems.json", value!({"robot": "r", "problems": [problem]}).to_string());
    json(&[&["plan", "--simplify", "--problems", &problems, "--robot"], arm].concat())["results"][0]
        .clone()
}

#[test]
fn a_joint_without_end_takes_the_short_way_round_and_starts_anywhere() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let ball = |x: f64, y: f64| value!([{"center": [x, y, 0], "radius": 0.05}]);
    let none = value!([]);
    for (start, goal, balls, cost) in [
        (3.1, -3.1, &none, 0.0832),
        (15.0, 15.1, &none, 0.1),
        (3.0, -3.0, &ball(0.3, 0.0), 0.2832),
        (-3.0, 3.0, &ball(0.3, 0.0), 0.2832),
        // Something is in the short way: the other way round.
        (2.7, -2.7, &ball(-0.3, 0.0), 5.4),
        // Many turns from home.
        (1e9, 1e9 + 0.1, &none, 0.1),
    ] {
        let result = plan(&folder, &[&arm], &value!([start]), &value!([goal]), balls);
        let found = result["cost"].as_f64().unwrap_or(f64::NAN);
        assert!((found - cost).abs() < 1e-3, "{start} to {goal}: {result}");
    }
    let kept = plan(&folder, &[&arm, "--limit-continuous"], &value!([0.0]), &value!([2.0]), &none);
    assert_eq!(kept["reason"], "outside_limits", "{kept}");
}

#[test]
fn a_joint_without_end_is_solved_near_the_seed_wherever_that_is() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let pose = json(&["fk", "--robot", &arm, "--configs", &configs])["poses"][0].clone();
    for seed in [0.0, 7.0, -20.0, 1e6] {
        let mut query = pose.clone();
        query["seed_config"] = value!([seed]);
        let poses = folder.write("poses.json", value!({"poses": [query]}).to_string());
        let found = json(&["ik", "--robot", &arm, "--poses", &poses]);
        let q = found["results"][0]["solutions"][0][0].as_f64().unwrap();
        let turns = (q - 0.5) / core::f64::consts::TAU;
        assert!((turns - turns.round()).abs() < 1e-4, "{found}");
        assert!(seed > 100.0 || (q - seed).abs() < 3.15, "{seed}: {found}");
    }
}

#[test]
fn a_seed_outside_the_limits_of_a_built_in_arm_is_turned_back_inside() {
    let folder = Folder::new();
    let start = lpr_core::robot::XARM7.start;
    let configs = folder.write("configs.json", value!({"configs": [start.to_vec()]}).to_string());
    let pose = json(&["fk", "--configs", &configs])["poses"][0].clone();
    for (joint, q) in [(6, 9.0), (6, -9.0), (0, 40.0), (3, 9.0), (1, -5.0)] {
        let mut seed = start.to_vec();
        seed[joint] = q;
        let mut query = pose.clone();
        query["seed_config"] = value!(seed);
        let poses = folder.write("poses.json", value!({"poses": [query]}).to_string());
        let found = json(&["ik", "--poses", &poses]);
        let solutions = found["results"][0]["solutions"].as_array().unwrap();
        assert_eq!(solutions.len(), 1, "joint {joint} at {q}: {found}");
    }
}

#[test]
fn files_in_latin_letters_with_a_mark_or_a_name_in_capitals_are_read() {
    let folder = Folder::new();
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let expected = {
        let arm = folder.write("plain.urdf", TURNTABLE);
        json(&["fk", "--robot", &arm, "--configs", &configs])
    };
    let latin =
        [b"<?xml version='1.0' encoding='ISO-8859-1'?><!-- caf\xe9 -->", TURNTABLE.as_bytes()]
            .concat();
    let marked = [b"\xef\xbb\xbf", TURNTABLE.as_bytes()].concat();
    let prefixed = TURNTABLE.replace("</robot>", "<gazebo><sensor:ray a:b='1'/></gazebo></robot>");
    for (name, bytes) in [
        ("latin.urdf", latin.as_slice()),
        ("marked.urdf", &marked),
        ("CAPITALS.URDF", TURNTABLE.as_bytes()),
        ("prefixed.urdf", prefixed.as_bytes()),
    ] {
        let arm = folder.write(name, bytes);
        assert_eq!(json(&["fk", "--robot", &arm, "--configs", &configs]), expected, "{name}");
    }
    let broken = folder.write("broken.urdf", [TURNTABLE.as_bytes(), b"\n\xff"].concat());
    let error = refusal(&["fk", "--robot", &broken, "--configs", &configs], 1);
    assert!(error.contains("line 5: expected UTF-8 text, found byte 0xff"), "{error}");
}

#[test]
fn a_xacro_file_is_refused_with_the_command_that_expands_it() {
    let folder = Folder::new();
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let xacro = folder.write("arm.urdf.xacro", TURNTABLE);
    let error = refusal(&["fk", "--robot", &xacro, "--configs", &configs], 1);
    assert!(error.contains("`xacro ") && error.contains("arm.urdf.xacro > FILE.urdf`"), "{error}");
    let inside = folder.write("arm.urdf", TURNTABLE.replace("0.3 0 0", "${reach} 0 0"));
    let error = refusal(&["fk", "--robot", &inside, "--configs", &configs], 1);
    assert!(error.contains("link 'arm'") && error.contains("`xacro FILE > FILE.urdf`"), "{error}");
}

#[test]
fn meshes_are_found_in_packages_and_missed_only_where_collisions_count() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path().join("elsewhere/meshes")).unwrap();
    folder.write("elsewhere/meshes/a.obj", TETRAHEDRON);
    let arm = folder.write("arm.urdf", with_mesh("package://parts/meshes/a.obj"));
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    json(&["fk", "--robot", &arm, "--configs", &configs]);

    let (zero, one, none) = (value!([0.0]), value!([0.9]), value!([]));
    let elsewhere = folder.at("elsewhere");
    let package = format!("parts={elsewhere}");
    assert_eq!(plan(&folder, &[&arm, "--package", &package], &zero, &one, &none)["solved"], true);
    let problems = folder.at("problems.json");
    let arguments = ["plan", "--robot", &arm, "--problems", &problems];
    let error = refusal(&arguments, 1);
    assert!(
        error.contains(
            "link 'arm', <mesh> on line 2: there is no mesh 'package://parts/meshes/a.obj'"
        ),
        "{error}"
    );
    assert!(error.contains("--ignore-missing-meshes"), "{error}");
    let lenient = command(&[&arguments[..], &["--ignore-missing-meshes", "--json"]].concat())
        .output()
        .unwrap();
    assert!(lenient.status.success());
    assert!(text(&lenient.stderr).starts_with("warning: link 'arm'"), "{}", text(&lenient.stderr));

    // A workspace of packages, as ROS lists them.
    std::fs::rename(folder.path().join("elsewhere"), folder.path().join("parts")).unwrap();
    let workspace = Folder::new();
    let moved = workspace.write("arm.urdf", with_mesh("package://parts/meshes/a.obj"));
    let arguments = ["plan", "--robot", &moved, "--problems", &problems];
    refusal(&arguments, 1);
    for listed in [folder.at(""), folder.at("parts")] {
        let mut command = command(&arguments);
        let output =
            command.env("ROS_PACKAGE_PATH", format!("/nowhere:{listed}")).output().unwrap();
        assert!(output.status.success(), "{listed}: {}", text(&output.stderr));
    }
    let mut wrong = command(&arguments);
    wrong.args(["--package", "parts"]);
    assert!(refusal_of(wrong, 2).contains("expected NAME=DIR"));
}

#[test]
fn a_group_of_the_semantics_is_chosen_by_name() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let srdf = folder.write(
        "turntable.srdf",
        r#"<robot name="turntable"><group name="table"><joint name="turn"/></group>
        <disable_collisions link1="base" link2="lamp"/></robot>"#,
    );
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let fk = |rest: &[&'static str]| {
        let given = ["fk", "--robot", &arm, "--configs", &configs];
        given.iter().chain(rest).map(|it| (*it).to_owned()).collect::<Vec<String>>()
    };
    let with_srdf =
        |rest: &[&'static str]| [fk(rest), vec!["--srdf".to_owned(), srdf.clone()]].concat();
    let output = command(&with_srdf(&["--group", "table"])).output().unwrap();
    assert!(output.status.success());
    assert!(
        text(&output.stderr).contains("warning: SRDF: 1 links that the URDF does not have: 'lamp'")
    );
    let error = refusal(&with_srdf(&["--group", "leg"]), 1);
    assert!(error.contains("group: expected one of 'table', found 'leg'"), "{error}");
    refusal(&fk(&["--group", "table"]), 2);
}

/// A base of that geometry, and a ball of 2 cm, 0.5 m away, that turns about z and slides up and
/// down; at 0 it is 1 mm above z = 0.
fn over_a_base(geometry: &str) -> String {
    format!(
        r#"<robot name="r"><link name="plate"><collision><origin xyz="0 0 -0.015"/><geometry>{geometry}</geometry></collision></link>
        <link name="mast"/>
        <link name="ball"><collision><origin xyz="0.5 0 0.021"/><geometry><sphere radius="0.02"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="plate"/><child link="mast"/><axis xyz="0 0 1"/>
          <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
        <joint name="lift" type="prismatic"><parent link="mast"/><child link="ball"/><axis xyz="0 0 1"/>
          <limit lower="-0.1" upper="0.5" velocity="1" effort="1"/></joint></robot>"#
    )
}

#[test]
fn a_ball_passes_a_millimetre_above_a_base_plate_and_not_through_it() {
    let folder = Folder::new();
    let corners = (0..8).map(|i| {
        let side = |bit: u32, half: f64| if i >> bit & 1 == 1 { half } else { -half };
        format!("v {} {} {}\n", side(0, 0.8), side(1, 0.6), side(2, 0.015))
    });
    let corners: String = corners.collect();
    let faces = "f 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\nf 2 8 6\n";
    folder.write("plate.obj", format!("{corners}{faces}"));
    for geometry in [
        r#"<box size="1.6 1.2 0.03"/>"#,
        r#"<cylinder radius="0.8" length="0.03"/>"#,
        r#"<mesh filename="plate.obj"/>"#,
    ] {
        let arm = folder.write("plate.urdf", over_a_base(geometry));
        let planned =
            |start: Value, goal: Value| plan(&folder, &[&arm], &start, &goal, &value!([]));
        let over = planned(value!([-1, 0]), value!([1, 0]));
        assert!(
            (over["cost"].as_f64().unwrap_or(f64::NAN) - 2.0).abs() < 1e-4,
            "{geometry}: {over}"
        );
        let inside = planned(value!([-1, -0.002]), value!([1, 0]));
        let contact = inside["contact"].as_str().unwrap_or_default();
        assert!(
            contact.contains("link ball and link plate, 0.0010 m deep"),
            "{geometry}: {inside}"
        );

        // What the ball carries must not touch the plate either, unless it is said that it may.
        let held = |touching: Value| {
            let attached = value!({"spheres": [{"center": [0.5, 0, 0], "radius": 0.01}], "touching": touching});
            let problem = value!({"name": "p", "start": [-1, 0.005], "goals": [[1, 0.005]], "attached": attached});
            let file = value!({"robot": "r", "problems": [problem]});
            let file = folder.write("held.json", file.to_string());
            json(&["plan", "--robot", &arm, "--problems", &file])["results"][0].clone()
        };
        let touches = held(value!(["ball"]));
        let contact = touches["contact"].as_str().unwrap_or_default();
        assert!(
            contact.contains("link attached and link plate, 0.0050 m"),
            "{geometry}: {touches}"
        );
        assert_eq!(held(value!(["ball", "plate"]))["solved"], true, "{geometry}");
    }
}

#[test]
fn a_small_ball_on_a_long_arm_does_not_swing_through_a_post() {
    let folder = Folder::new();
    let arm = folder.write(
        "long.urdf",
        r#"<robot name="r"><link name="base"/>
        <link name="arm"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.005"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
          <limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"#,
    );
    for i in 0..12 {
        let angle = 0.52 + 0.0053 * f64::from(i);
        let post = value!([{"center": [angle.cos(), angle.sin(), 0], "radius": 0.001}]);
        // The only other way round is beyond the limits: to find none takes few samples.
        let problem = value!({"name": "p", "start": [-1], "goals": [[1]], "spheres": post});
        let file = value!({"robot": "r", "problems": [problem]});
        let file = folder.write("post.json", file.to_string());
        let arguments = ["plan", "--robot", &arm, "--planner", "stomp", "--problems", &file];
        let result = json(&arguments)["results"][0].clone();
        assert_eq!(result["solved"], false, "post at {angle}: {result}");
    }
}

/// A plate, a column that touches it always, two arms and fingers of which one follows.
const GRIPPER_ARM: &str = r#"<robot name="picker">
  <link name="plate"><collision><geometry><box size="0.5 0.5 0.02"/></geometry></collision></link>
  <link name="column"><collision><geometry><cylinder radius="0.04" length="0.2"/></geometry><origin xyz="0 0 0.1"/></collision></link>
  <link name="upper"><collision><geometry><sphere radius="0.06"/></geometry><origin xyz="0.1 0 0"/></collision></link>
  <link name="cover"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
  <link name="wrist"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
  <link name="left"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="right"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="plate"/><child link="column"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="column"/><child link="upper"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="2" effort="1"/></joint>
  <joint name="cap" type="fixed"><parent link="upper"/><child link="cover"/><origin xyz="0.15 0 0"/></joint>
  <joint name="reach" type="prismatic"><parent link="upper"/><child link="wrist"/><origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" velocity="0.5" effort="1"/></joint>
  <joint name="close" type="prismatic"><parent link="wrist"/><child link="left"/><origin xyz="0.05 0.02 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.02" velocity="0.1" effort="1"/></joint>
  <joint name="close_too" type="prismatic"><parent link="wrist"/><child link="right"/><origin xyz="0.05 -0.02 0"/><axis xyz="0 1 0"/>
    <limit lower="-0.02" upper="0" velocity="0.1" effort="1"/><mimic joint="close" multiplier="-1"/></joint>
</robot>"#;

#[test]
fn a_description_is_told_before_anything_is_planned() {
    let folder = Folder::new();
    let arm = folder.write("picker.urdf", GRIPPER_ARM);
    let (srdf, picture) = (folder.at("picker.srdf"), folder.at("picker.png"));
    let told = json(&[
        "robots",
        "--describe",
        &arm,
        "--tip",
        "wrist",
        "--write-srdf",
        &srdf,
        "--draw",
        &picture,
    ]);
    assert_eq!((&told["base"], &told["tip"]), (&value!("plate"), &value!("wrist")));
    let kinds: Vec<&Value> =
        told["joints"].as_array().unwrap().iter().map(|it| &it["kind"]).collect();
    assert_eq!(kinds, ["continuous", "revolute", "prismatic"]);
    assert_eq!(told["joints"][0]["limits"], Value::Null);
    assert_eq!(told["joints"][2]["limits"], value!([0.0, 0.05]));
    let tips = value!([{"link": "left", "joints": 4}]);
    assert!(told["tips"].as_array().unwrap().contains(&tips[0]), "{}", told["tips"]);
    let plate = &told["links"][0];
    assert_eq!((&plate["name"], &plate["exact"]), (&value!("plate"), &value!(true)), "{plate}");
    // A cover that reaches to the wrist stays a spot where they touch; the plate, which the column
    // stands on, is its neighbour.
    let touching = told["pairs"]["touching"].as_array().unwrap();
    let named = |a: &str, b: &str| touching.iter().any(|it| it["links"] == value!([a, b]));
    assert!(!named("plate", "column"), "{touching:?}");
    let reach = told["reach"]["radius"].as_f64().unwrap();
    assert!(reach > 0.4 && reach < 0.46, "{reach}");
    let share = told["reach"]["share"].as_f64().unwrap();
    assert!(share > 0.005 && share < 0.2, "a sliding wrist reaches a shell: {share}");

    // What it writes says the same when it is read.
    let again = json(&["robots", "--describe", &arm, "--srdf", &srdf]);
    assert_eq!(again["tip"], "wrist", "by the group written");
    assert_eq!(again["pairs"]["allowed"], told["pairs"]["allowed"]);
    assert_eq!(again["pairs"]["tested"], told["pairs"]["tested"]);

    let file = std::io::BufReader::new(std::fs::File::open(&picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((frame.width, frame.height), (960, 720));
    let colors: std::collections::BTreeSet<&[u8]> = pixels.chunks(3).collect();
    assert!(colors.len() > 100, "{} colours", colors.len());

    let words = table(&["robots", "--describe", &arm, "--tip", "wrist"]);
    for line in
        ["picker: 3 joints from plate to wrist", "plate", "exact", "pairs of links are tested"]
    {
        assert!(words.contains(line), "{line}: {words}");
    }
    let wrong = refusal(&["robots", "--describe", &arm, "--draw", &folder.at("picker.gif")], 2);
    assert!(wrong.contains("expected a name that ends in .png"), "{wrong}");
    let wrong = refusal(&["robots", "--draw", &picture], 2);
    assert!(wrong.contains("--describe"), "{wrong}");
}

#[test]
fn pairs_that_the_users_srdf_disabled_are_written_as_the_users() {
    let folder = Folder::new();
    let arm = folder.write("picker.urdf", GRIPPER_ARM);
    let given = folder.write(
        "given.srdf",
        r#"<robot name="picker"><group name="arm"><chain base_link="plate" tip_link="wrist"/></group>
        <disable_collisions link1="plate" link2="wrist" reason="User"/>
        <disable_collisions link1="plate" link2="column" reason="Adjacent"/></robot>"#,
    );
    let written = folder.at("written.srdf");
    json(&["robots", "--describe", &arm, "--srdf", &given, "--write-srdf", &written]);
    let written = std::fs::read_to_string(&written).unwrap();
    for (pair, reason) in [
        (r#"link1="plate" link2="wrist""#, "User"),
        (r#"link1="plate" link2="column""#, "Adjacent"),
    ] {
        let line = written.lines().find(|line| line.contains(pair)).unwrap_or_default();
        assert!(line.contains(&format!(r#"reason="{reason}""#)), "{written}");
    }
}

/// A plate, and another on an arm of two joints that swings over it at a height of `gap` metres above
/// it once in a while.
fn swinging_plates(gap: f64) -> String {
    let plate = |name: &str, at: &str| {
        format!(
            r#"<link name="{name}"><collision><origin xyz="{at}"/><geometry><box size="0.3 0.3 0.02"/></geometry></collision></link>"#
        )
    };
    let joint = |name: &str, parent: &str, child: &str, at: &str| {
        format!(
            r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
            <axis xyz="0 0 1"/><limit lower="-3.1" upper="3.1" velocity="1" effort="1"/></joint>"#
        )
    };
    format!(
        r#"<robot name="plates"><link name="base"/>{}<link name="arm"/>{}{}{}{}</robot>"#,
        plate("lower", "0 0 0"),
        plate("upper", &format!("0.4 0 {}", 0.02 + gap)),
        joint("first", "base", "lower", "0 0 0"),
        joint("second", "lower", "arm", "0 0 0"),
        joint("third", "arm", "upper", "0.4 0 0"),
    )
}

#[test]
fn links_that_touch_as_spheres_alone_are_no_obstacle_to_each_other() {
    let folder = Folder::new();
    let told = |gap: f64, options: &[&str]| {
        let arm = folder.write("plates.urdf", swinging_plates(gap));
        json(&[&["robots", "--describe", &arm, "--overshoot", "20"], options].concat())["pairs"]
            .clone()
    };
    let written = folder.at("plates.srdf");
    let near = told(0.01, &["--write-srdf", &written]);
    let pair = &near["touching"][0];
    assert_eq!(pair["links"], value!(["lower", "upper"]), "{near}");
    assert_eq!(pair["kind"], "never");
    let share = pair["share"].as_f64().unwrap();
    assert!(share > 0.05 && share < 0.9, "{share}");
    let srdf = std::fs::read_to_string(&written).unwrap();
    assert!(srdf.contains(r#"link1="lower" link2="upper" reason="Never""#), "{srdf}");
    // The plates themselves meet.
    assert_eq!(told(-0.01, &[])["touching"], value!([]));
    assert_eq!(told(0.01, &["--test-all-pairs"])["touching"], value!([]));
}

#[test]
fn spheres_reach_no_further_beyond_a_link_than_is_asked_for() {
    let folder = Folder::new();
    let arm =
        folder.write("plates.urdf", swinging_plates(0.01).replace("0.3 0.3 0.02", "0.2 0.1 0.02"));
    let spheres = |options: &[&str]| {
        let told = json(&[&["robots", "--describe", &arm], options].concat());
        let link = &told["links"][0];
        (link["spheres"].as_u64().unwrap(), link["overshoot"].as_f64().unwrap())
    };
    let (n, overshoot) = spheres(&[]);
    let (n_wide, overshoot_wide) = spheres(&["--overshoot", "40"]);
    assert!(overshoot <= 0.01001 && overshoot_wide <= 0.04001, "{overshoot} {overshoot_wide}");
    assert!(n_wide < n && n <= 256, "{n} {n_wide}");
    let wrong = refusal(&["robots", "--describe", &arm, "--overshoot", "0"], 2);
    assert!(wrong.contains("expected a number from 1 to 1000"), "{wrong}");
    let wrong = refusal(&["fk", "--overshoot", "5", "--configs", &arm], 2);
    assert!(wrong.contains("--overshoot: only for a URDF file"), "{wrong}");
}
