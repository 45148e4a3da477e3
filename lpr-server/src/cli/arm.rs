//! Which arm a command of kinematics or planning is about: a built-in one or a description in
//! files.

use super::failure::{Failure, Result};
use crate::files::{self, FileError};
use lpr_core::robot::{JointConfig, ROBOTS, Robot};
use std::path::{Path, PathBuf};

/// Most bytes of a description or mesh.
const MAX_BYTES: u64 = 256 << 20;

/// Of the built-in arms the flange counts, of others the tip.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ArmArguments {
    /// The arm: xarm7, panda or a URDF file
    #[arg(long, value_name = "NAME|FILE.urdf", default_value = &*ROBOTS[0].name)]
    robot: String,
    /// SRDF of a URDF file: its first group that is a chain, and which links may touch
    #[arg(long, value_name = "FILE")]
    srdf: Option<PathBuf>,
    /// Link of a URDF file to count as its tip [default: that of the SRDF's group, else the only
    /// one]
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
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
    pub(super) fn load(&self) -> Result<Arm> {
        let path = Path::new(&self.robot);
        if path.extension().is_none_or(|extension| extension != "urdf") {
            if let Some(option) = [("--srdf", self.srdf.is_some()), ("--tip", self.tip.is_some())]
                .iter()
                .find(|(_, given)| *given)
            {
                return Err(Failure::Usage(format!(
                    "{}: only for a URDF file, --robot is {}",
                    option.0, self.robot
                )));
            }
            let robot = Robot::by_name(&self.robot)
                .map_err(|error| Failure::Usage(format!("--robot: {error}, or a FILE.urdf")))?;
            return Ok(Arm::new(robot.described()));
        }
        let urdf = read_text(path)?;
        let srdf = self.srdf.as_deref().map(read_text).transpose()?;
        let folder = path.parent().unwrap_or_else(|| Path::new(""));
        let meshes = |name: &str| find_mesh(folder, name);
        let robot = Robot::from_urdf(&urdf, srdf.as_deref(), self.tip.as_deref(), &meshes);
        Ok(Arm::new(robot.map_err(|error| FileError::content(path, error.to_string()))?))
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

    /// The configuration that a file has in `field`: one number for each joint.
    pub(super) fn config(&self, values: &[f32], path: &Path, field: &str) -> Result<JointConfig> {
        let dof = self.robot.dof();
        if values.len() != dof {
            let reason = format!(
                "{field}: has {} joint angles, {} has {dof}",
                values.len(),
                self.robot.name
            );
            return Err(FileError::content(path, reason).into());
        }
        if let Some(joint) = values.iter().position(|q| !q.is_finite()) {
            return Err(FileError::content(
                path,
                format!("{field}[{joint}]: is not a finite number"),
            )
            .into());
        }
        Ok(JointConfig::from_fn(dof, |j| values[j]))
    }

    /// The joints that there are.
    pub(super) fn joints(&self, config: &JointConfig) -> Vec<f32> {
        config.to_vec()
    }
}

fn read_text(path: &Path) -> Result<String> {
    let bytes = files::read_bounded(path, MAX_BYTES)?;
    Ok(String::from_utf8(bytes)
        .map_err(|error| FileError::content(path, format!("is not UTF-8 text: {error}")))?)
}

/// A mesh next to the description, or in the package that its name begins with: the nearest folder
/// above of that name or with it.
fn find_mesh(folder: &Path, name: &str) -> Option<Vec<u8>> {
    let Some(in_package) = name.strip_prefix("package://") else {
        return files::read_bounded(
            &folder.join(name.strip_prefix("file://").unwrap_or(name)),
            MAX_BYTES,
        )
        .ok();
    };
    let (_, inside) = in_package.split_once('/')?;
    let folder = folder.canonicalize().ok()?;
    let places = folder.ancestors().flat_map(|above| [above.join(in_package), above.join(inside)]);
    places.into_iter().find_map(|place| files::read_bounded(&place, MAX_BYTES).ok())
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
            let read = arm.config(&values, Path::new("a.json"), "configs[4]");
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
