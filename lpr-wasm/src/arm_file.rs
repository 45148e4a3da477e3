//! An arm as its maker describes it: a URDF file with its meshes, which the page has fetched.

use crate::planner::{Obstacles, Planner};
use lpr_core::error::Result;
use lpr_core::robot::{Described, Robot, UrdfOptions, decode_xml};
use lpr_core::scene::overlaps;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What is said of a file besides what it says: as the options of `lpr robots --describe`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmOptions {
    /// Text of an SRDF file.
    pub srdf: Option<String>,
    /// A group of it; else the one with the most joints that is a chain.
    pub group: Option<String>,
    /// Name of the link that plans move; else the only one there is.
    pub tip: Option<String>,
    /// Keep the limits that a continuous joint states.
    pub limit_continuous: bool,
    /// Leave out meshes that are not there or cannot be read.
    pub ignore_missing_meshes: bool,
    /// Furthest that spheres reach beyond a link, metres.
    pub overshoot: Option<f32>,
    /// Test also the pairs of links that always touch.
    pub test_all_pairs: bool,
}

/// A URDF file with its meshes.
#[derive(Debug, Clone)]
pub struct ArmFile {
    urdf: String,
    options: ArmOptions,
    meshes: BTreeMap<String, Vec<u8>>,
}

/// An arm of a file, for those who show it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ArmSummary {
    /// Name of the robot.
    pub name: String,
    /// Name of the first link.
    pub base: String,
    /// Name of the link that plans move.
    pub tip: String,
    /// Names of the joints, in the order of a configuration's numbers.
    pub joints: Vec<String>,
    /// Limits of each joint, radians or metres; none of one that turns without end.
    pub limits: Vec<Option<[f32; 2]>>,
    /// What was left out, and where.
    pub warnings: Vec<String>,
}

impl ArmFile {
    /// The file of those bytes.
    ///
    /// # Errors
    ///
    /// When they are no text in the encoding that they state.
    pub fn new(urdf: &[u8], options: ArmOptions) -> Result<Self> {
        Ok(Self { urdf: decode_xml(urdf)?, options, meshes: BTreeMap::new() })
    }

    /// Adds a mesh by the name that the file gives it: the bytes of an STL, OBJ or COLLADA file.
    pub fn add_mesh(&mut self, name: &str, bytes: Vec<u8>) {
        self.meshes.insert(name.to_owned(), bytes);
    }

    /// The names of the meshes that the file asks for, sorted, those that were added too.
    ///
    /// # Errors
    ///
    /// As [`Self::summary`], but for meshes.
    pub fn mesh_names(&self) -> Result<Vec<String>> {
        let names = RefCell::new(BTreeSet::new());
        let options = UrdfOptions { ignore_missing_meshes: true, ..self.urdf_options() };
        Robot::describe(&self.urdf, &options, &|name| {
            names.borrow_mut().insert(name.to_owned());
            None
        })?;
        Ok(names.into_inner().into_iter().collect())
    }

    /// The arm with its joints.
    ///
    /// # Errors
    ///
    /// When the file describes no arm, or a mesh is not there; the message names the line, link or
    /// joint.
    pub fn summary(&self) -> Result<ArmSummary> {
        let options = UrdfOptions { without_geometry: true, ..self.urdf_options() };
        let Described { robot, warnings, base, tip, .. } =
            Robot::describe(&self.urdf, &options, &|_| None)?;
        let limits = (robot.joints.iter())
            .map(|joint| (!joint.is_continuous).then_some([joint.lower, joint.upper]));
        Ok(ArmSummary {
            limits: limits.collect(),
            joints: robot.joints.iter().map(|joint| joint.name.clone()).collect(),
            name: robot.name,
            base,
            tip,
            warnings,
        })
    }

    /// A planner of the arm among obstacles.
    ///
    /// # Errors
    ///
    /// As [`Self::summary`] and [`Planner::new`].
    pub fn planner(&self, obstacles: &Obstacles) -> Result<Planner> {
        let meshes = |name: &str| self.meshes.get(name).cloned();
        let mut robot = Robot::describe(&self.urdf, &self.urdf_options(), &meshes)?.robot;
        if !self.options.test_all_pairs {
            let found = overlaps(&robot)?;
            robot.allow(&found);
        }
        Planner::of(Arc::new(robot), obstacles)
    }

    fn urdf_options(&self) -> UrdfOptions<'_> {
        UrdfOptions {
            srdf: self.options.srdf.as_deref(),
            group: self.options.group.as_deref(),
            tip: self.options.tip.as_deref(),
            limit_continuous: self.options.limit_continuous,
            without_geometry: false,
            ignore_missing_meshes: self.options.ignore_missing_meshes,
            overshoot: self.options.overshoot,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAR: &str = r#"<robot name="bar"><link name="base"/><link name="bar"><collision>
        <geometry><mesh filename="package://bar/bar.obj"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="2" velocity="1" effort="1"/></joint></robot>"#;

    #[test]
    fn a_file_says_which_meshes_it_wants_and_plans_with_them() {
        let mut file = ArmFile::new(BAR.as_bytes(), ArmOptions::default()).unwrap();
        assert_eq!(file.mesh_names().unwrap(), ["package://bar/bar.obj"]);
        let summary = file.summary().unwrap();
        assert_eq!((&*summary.name, &*summary.tip), ("bar", "bar"));
        assert_eq!(summary.limits, [Some([-1.0, 2.0])]);
        let error = file.planner(&Obstacles::default()).unwrap_err().to_string();
        assert!(error.contains("bar.obj"), "{error}");
        file.add_mesh("package://bar/bar.obj", b"v 0 0 0\nv 1 0 0\nv 0 .1 0\nf 1 2 3".to_vec());
        assert!(file.planner(&Obstacles::default()).is_ok());
    }

    #[test]
    fn a_file_that_is_no_arm_is_refused_by_line() {
        let file = ArmFile::new(b"<robot>\n<link/></robot>", ArmOptions::default()).unwrap();
        let error = file.summary().unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
        assert!(ArmFile::new(b"\xff", ArmOptions::default()).is_err());
    }
}
