//! Which arm a command of kinematics or planning is about: a built-in one or a description in
//! files.

use super::failure::{Failure, Result};
use super::output;
use crate::files::{self, FileError};
use core::f64::consts::TAU;
use lpr_core::robot::{Described, JointConfig, ROBOTS, Robot, UrdfOptions, decode_xml};
use lpr_core::scene::{Overlap, overlaps};
use std::path::{Path, PathBuf};

/// Angle of a joint without end up to which f32 is exact to a hundred-thousandth, radians.
const MAX_WOUND: f64 = 100.0;

/// A position beyond a limit by no more than this is at the limit, radians or metres: files round π,
/// and limits, in their own ways.
const ROUNDING: f32 = 1e-4;

/// Most bytes of a description or mesh.
const MAX_BYTES: u64 = 256 << 20;

/// Of the built-in arms the flange counts, of others the tip.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ArmArguments {
    /// The arm: xarm7, panda or a URDF file
    #[arg(long, value_name = "NAME|FILE.urdf", default_value = &*ROBOTS[0].name)]
    robot: String,
    #[command(flatten)]
    file: FileArguments,
}

/// What is said of a URDF file beside its name.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct FileArguments {
    /// SRDF of a URDF file: which links may touch, and groups that are chains
    #[arg(long, value_name = "FILE")]
    srdf: Option<PathBuf>,
    /// Group of the SRDF that is the arm [default: the one with the most joints that is a chain]
    #[arg(long, value_name = "NAME", requires = "srdf")]
    group: Option<String>,
    /// Link of a URDF file to count as its tip [default: that of the SRDF's group, else the only
    /// one]
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// Folder of a package that a URDF file names, may be repeated [default: `ROS_PACKAGE_PATH`, then
    /// the nearest folder of that name above the file]
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = parse_package)]
    packages: Vec<Package>,
    /// Keeps the limits that a continuous joint of a URDF file states
    #[arg(long)]
    limit_continuous: bool,
    /// Leaves out the meshes of a URDF file that cannot be read
    #[arg(long)]
    ignore_missing_meshes: bool,
    /// Furthest that the spheres of a URDF file's links reach beyond them [default: 10]; a plan takes
    /// the less time the more it is
    #[arg(long, value_name = "MM", value_parser = parse_overshoot)]
    overshoot: Option<f32>,
    /// Tests pairs of links of a URDF file, too, that touch at rest or nearly always
    #[arg(long)]
    test_all_pairs: bool,
}

/// A ROS package and its folder.
#[derive(Debug, Clone)]
struct Package {
    name: String,
    folder: PathBuf,
}

fn parse_package(text: &str) -> Result<Package, String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => {
            Ok(Package { name: name.to_owned(), folder: folder.into() })
        }
        _ => Err("expected NAME=DIR".to_owned()),
    }
}

fn parse_overshoot(text: &str) -> Result<f32, String> {
    let value = text.parse::<f32>().ok().filter(|value| (1.0..=1000.0).contains(value));
    value.ok_or_else(|| "expected a number from 1 to 1000".to_owned())
}

/// The parts of a description that a command needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Needs {
    /// Joints and frames: no mesh is opened.
    Kinematics,
    /// The geometry, too.
    Collisions,
}

/// An arm with what is known of its kinematics.
#[derive(Debug)]
pub(super) struct Arm {
    /// Of a built-in arm its description: the flange is its grip.
    pub(super) robot: Robot,
    /// The built-in arm with the same kinematics, and the tip as its grip.
    pub(super) closed_form: Option<Robot>,
    /// Configuration at which the search for solutions starts.
    pub(super) start: JointConfig,
}

impl ArmArguments {
    /// Reads what the arguments name.
    pub(super) fn load(&self, needs: Needs) -> Result<Arm> {
        let path = Path::new(&self.robot);
        let is_file = path.extension().is_some_and(|it| it.eq_ignore_ascii_case("urdf"));
        if !is_file && self.robot.to_ascii_lowercase().ends_with(".xacro") {
            return Err(FileError::content(
                path,
                format!(
                    "is a xacro file: expected a URDF, as of `xacro {} > FILE.urdf`",
                    path.display()
                ),
            )
            .into());
        }
        if !is_file {
            if let Some(option) = self.file.first_given() {
                return Err(Failure::Usage(format!(
                    "{option}: only for a URDF file, --robot is {}",
                    self.robot
                )));
            }
            let robot = Robot::by_name(&self.robot)
                .map_err(|error| Failure::Usage(format!("--robot: {error}, or a FILE.urdf")))?;
            return Ok(Arm::new(robot.described()));
        }
        let FileArm { described, .. } = self.file.read(path, needs)?;
        described.warnings.iter().for_each(|warning| output::report_warning(warning));
        Ok(Arm::new(described.robot))
    }
}

/// An arm from a file, and the pairs of its links that were found to touch always.
#[derive(Debug)]
pub(super) struct FileArm {
    pub(super) described: Described,
    /// None without collisions, or where all pairs are tested.
    pub(super) overlaps: Vec<Overlap>,
}

impl FileArguments {
    /// The first of the options that is given.
    fn first_given(&self) -> Option<&'static str> {
        let given = [
            ("--srdf", self.srdf.is_some()),
            ("--tip", self.tip.is_some()),
            ("--package", !self.packages.is_empty()),
            ("--limit-continuous", self.limit_continuous),
            ("--ignore-missing-meshes", self.ignore_missing_meshes),
            ("--overshoot", self.overshoot.is_some()),
            ("--test-all-pairs", self.test_all_pairs),
        ];
        given.iter().find(|(_, given)| *given).map(|(option, _)| *option)
    }

    /// The URDF file at `path` with what the other arguments say of it.
    pub(super) fn read(&self, path: &Path, needs: Needs) -> Result<FileArm> {
        let urdf = read_text(path)?;
        let srdf = self.srdf.as_deref().map(read_text).transpose()?;
        let folder = path.parent().unwrap_or_else(|| Path::new(""));
        let meshes = |name: &str| self.find_mesh(folder, name);
        let options = UrdfOptions {
            srdf: srdf.as_deref(),
            group: self.group.as_deref(),
            tip: self.tip.as_deref(),
            limit_continuous: self.limit_continuous,
            without_geometry: needs == Needs::Kinematics,
            ignore_missing_meshes: self.ignore_missing_meshes,
            overshoot: self.overshoot.map(|millimetres| 1e-3 * millimetres),
        };
        let found = Robot::describe(&urdf, &options, &meshes);
        let mut described = found.map_err(|error| {
            // How to go on without it is this program's to say.
            let message = error.to_string();
            let is_mesh = message.contains("<mesh>") && !self.ignore_missing_meshes;
            let hint = if is_mesh { "; --ignore-missing-meshes leaves it out" } else { "" };
            FileError::content(path, format!("{message}{hint}"))
        })?;
        let overlaps = if needs == Needs::Kinematics || self.test_all_pairs {
            Vec::new()
        } else {
            let found = overlaps(&described.robot);
            found.map_err(|error| FileError::content(path, error.to_string()))?
        };
        described.robot.allow(&overlaps);
        Ok(FileArm { described, overlaps })
    }

    /// A mesh next to the description, or in the package that its name begins with.
    fn find_mesh(&self, folder: &Path, name: &str) -> Option<Vec<u8>> {
        let read = |place: PathBuf| files::read_bounded(&place, MAX_BYTES).ok();
        let Some(in_package) = name.strip_prefix("package://") else {
            return read(folder.join(name.strip_prefix("file://").unwrap_or(name)));
        };
        let (package, inside) = in_package.split_once('/')?;
        if let Some(given) = self.packages.iter().find(|it| it.name == package) {
            return read(given.folder.join(inside));
        }
        let listed = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
        let listed = std::env::split_paths(&listed)
            .filter(|place| !place.as_os_str().is_empty())
            .map(|place| match place.file_name() {
                Some(name) if name == package => place.join(inside),
                _ => place.join(in_package),
            });
        let folder = folder.canonicalize().ok()?;
        let above =
            folder.ancestors().flat_map(|above| [above.join(in_package), above.join(inside)]);
        listed.chain(above).find_map(read)
    }
}

impl Arm {
    fn new(robot: Robot) -> Self {
        let closed_form = robot.as_built_in();
        let start = closed_form.as_ref().map_or(robot.start, |built_in| built_in.start);
        Self { robot, closed_form, start }
    }

    /// Refuses a file that is for another of the built-in arms. What other arms are called is up to
    /// whoever describes them.
    pub(super) fn check_name(&self, name: &str, path: &Path) -> Result<()> {
        match &self.closed_form {
            Some(built_in) if built_in.name != name && Robot::by_name(name).is_ok() => Err(
                FileError::content(path, format!("robot: is {name}, --robot is {}", built_in.name))
                    .into(),
            ),
            _ => Ok(()),
        }
    }

    /// The configuration that a file has in `field`: one number for each joint. A joint that turns
    /// without end may have turned often: what f32 would round is reduced to less than a turn.
    pub(super) fn config(&self, values: &[f64], path: &Path, field: &str) -> Result<JointConfig> {
        let dof = self.robot.dof();
        if values.len() != dof {
            let reason = format!(
                "{field}: has {} joint angles, {} has {dof}",
                values.len(),
                self.robot.name
            );
            return Err(FileError::content(path, reason).into());
        }
        let read = |j: usize| match self.robot.joints[j].is_continuous {
            true if values[j].abs() > MAX_WOUND => values[j].rem_euclid(TAU) as f32,
            _ => values[j] as f32,
        };
        let config = JointConfig::from_fn(dof, read);
        if let Some(joint) = config.iter().position(|q| !q.is_finite()) {
            return Err(FileError::content(
                path,
                format!("{field}[{joint}]: is not a finite number"),
            )
            .into());
        }
        Ok(config)
    }

    /// The same as an end of a path: what is beyond a limit by rounding is at the limit.
    pub(super) fn end(&self, values: &[f64], path: &Path, field: &str) -> Result<JointConfig> {
        let mut config = self.config(values, path, field)?;
        for (q, joint) in config.iter_mut().zip(&self.robot.joints) {
            let within = q.clamp(joint.lower, joint.upper);
            if (*q - within).abs() <= ROUNDING {
                *q = within;
            }
        }
        Ok(config)
    }

    /// The joints that there are.
    pub(super) fn joints(&self, config: &JointConfig) -> Vec<f32> {
        config.to_vec()
    }
}

fn read_text(path: &Path) -> Result<String> {
    let bytes = files::read_bounded(path, MAX_BYTES)?;
    Ok(decode_xml(&bytes).map_err(|error| FileError::content(path, error.to_string()))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_configuration_in_a_file_has_the_arms_joints_or_is_refused_by_its_field(
            values in prop::collection::vec(prop_oneof![8 => -3.0_f32..3.0, 1 => prop::num::f32::ANY], 5..9),
        ) {
            let arm = Arm::new(ROBOTS[0].described());
            let wide: Vec<f64> = values.iter().copied().map(f64::from).collect();
            let read = arm.config(&wide, Path::new("a.json"), "configs[4]");
            let broken = values.iter().position(|q| !q.is_finite());
            match (values.len() == 7, broken, read) {
                (true, None, Ok(config)) => prop_assert_eq!(arm.joints(&config), values),
                (true, Some(joint), Err(error)) => {
                    let field = format!("configs[4][{joint}]");
                    prop_assert!(error.to_string().contains(&field), "{error}");
                }
                (false, _, Err(error)) => prop_assert!(error.to_string().contains("configs[4]: has")),
                (_, _, read) => prop_assert!(false, "{read:?}"),
            }
        }
    }
}
