//! Files of motion planning problems.

use crate::files::{self, FileError, Result};
use crate::formats::unit_quaternion;
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::robot::Sphere;
use lpr_core::scene::{ArmSpheres, Primitive, Scene};
use serde::Deserialize;
use std::path::Path;

/// Largest length in a file, metres: what is larger is a unit gone wrong, and would overflow where
/// it is squared.
const MAX_LENGTH: f32 = 1000.0;

/// Radius of the ball around a point of a cloud when the file names none, metres.
const POINT_RADIUS: f32 = 0.01;

/// A file of problems for one arm. Lengths in metres, joints in radians; the world is the frame of the
/// description's root link, of a built-in arm its base.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProblemFile {
    /// Name of the arm that the problems are for.
    pub robot: String,
    /// The problems.
    pub problems: Vec<Problem>,
}

/// A start, goals of which any will do, and what must not be hit.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    /// Name by which results are listed.
    pub name: String,
    /// Configuration of the arm: one number for each joint, unchecked.
    pub start: Vec<f64>,
    /// Configurations that it may go to, likewise.
    pub goals: Vec<Vec<f64>>,
    #[serde(default)]
    spheres: Vec<SphereJson>,
    #[serde(default)]
    cuboids: Vec<CuboidJson>,
    #[serde(default)]
    capsules: Vec<CapsuleJson>,
    #[serde(default)]
    cylinders: Vec<CylinderJson>,
    #[serde(default)]
    points: Vec<[f32; 3]>,
    point_radius: Option<f32>,
    attached: Option<AttachedJson>,
}

/// What the tip carries: solids in its frame. The lists are those of a problem: serde cannot take
/// them from one struct and refuse unknown fields, too.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct AttachedJson {
    #[serde(default)]
    spheres: Vec<SphereJson>,
    #[serde(default)]
    cuboids: Vec<CuboidJson>,
    #[serde(default)]
    capsules: Vec<CapsuleJson>,
    #[serde(default)]
    cylinders: Vec<CylinderJson>,
    /// Names of the links that may touch it.
    #[serde(default)]
    touching: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereJson {
    center: [f32; 3],
    radius: f32,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct CuboidJson {
    center: [f32; 3],
    rotation_xyzw: [f64; 4],
    half_extents: [f32; 3],
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct CapsuleJson {
    a: [f32; 3],
    b: [f32; 3],
    radius: f32,
}

/// Along its own z.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct CylinderJson {
    center: [f32; 3],
    rotation_xyzw: [f64; 4],
    radius: f32,
    half_length: f32,
}

/// Reads a file of problems.
///
/// # Errors
///
/// When the file is missing or malformed, naming the field at fault.
pub fn read_problems(path: &Path) -> Result<ProblemFile> {
    files::read_json(path)
}

impl Problem {
    /// The obstacles of problem `idx` of the file at `path`.
    ///
    /// # Errors
    ///
    /// Naming a number that is not finite or more than a kilometre, a size below 0, or a quaternion
    /// that is none.
    pub fn scene(&self, path: &Path, idx: usize) -> Result<Scene> {
        let Self { spheres, cuboids, capsules, cylinders, .. } = self;
        let scene = Scene::from_primitives(
            primitives(spheres, cuboids, capsules, cylinders)
                .map_err(|reason| FileError::content(path, format!("problems[{idx}].{reason}")))?,
        );
        if self.points.is_empty() {
            return Ok(scene);
        }
        let point_radius = self.point_radius.unwrap_or(POINT_RADIUS);
        size("point_radius", point_radius)
            .map_err(|reason| FileError::content(path, format!("problems[{idx}].{reason}")))?;
        let points = self.points.iter().enumerate().map(|(i, point)| {
            place("", *point).map_err(|reason| {
                FileError::content(path, format!("problems[{idx}].points[{i}]{reason}"))
            })
        });
        Ok(scene.with_points(&points.collect::<Result<Vec<Vec3>>>()?, point_radius))
    }

    /// `arm` with what problem `idx` of the file at `path` attaches to its tip.
    ///
    /// # Errors
    ///
    /// As [`Self::scene`], and when `touching` names a link that has no spheres.
    pub fn attach(&self, arm: &ArmSpheres, path: &Path, idx: usize) -> Result<ArmSpheres> {
        let Some(attached) = &self.attached else {
            return Ok(arm.clone());
        };
        let at_fault =
            |reason: String| FileError::content(path, format!("problems[{idx}].attached.{reason}"));
        let AttachedJson { spheres, cuboids, capsules, cylinders, touching } = attached;
        let solids = primitives(spheres, cuboids, capsules, cylinders).map_err(at_fault)?;
        let touching: Vec<&str> = touching.iter().map(String::as_str).collect();
        let spheres: Vec<Vec<Sphere>> = solids
            .iter()
            .map(Primitive::covering_spheres)
            .collect::<Result<_, lpr_core::Error>>()
            .map_err(|error| at_fault(error.to_string()))?;
        arm.with_attached(&spheres.concat(), &touching)
            .map_err(|error| at_fault(format!("touching: {error}")))
    }
}

/// The solids of four lists, in their order, or what is wrong with which.
fn primitives(
    spheres: &[SphereJson],
    cuboids: &[CuboidJson],
    capsules: &[CapsuleJson],
    cylinders: &[CylinderJson],
) -> Checked<Vec<Primitive>> {
    fn list<T>(
        name: &str,
        list: &[T],
        read: fn(&T) -> Checked<Primitive>,
    ) -> Checked<Vec<Primitive>> {
        let read = |(i, item)| read(item).map_err(|reason| format!("{name}[{i}].{reason}"));
        list.iter().enumerate().map(read).collect()
    }
    Ok([
        list("spheres", spheres, SphereJson::primitive)?,
        list("cuboids", cuboids, CuboidJson::primitive)?,
        list("capsules", capsules, CapsuleJson::primitive)?,
        list("cylinders", cylinders, CylinderJson::primitive)?,
    ]
    .concat())
}

/// A value or what is wrong with which field.
type Checked<T> = core::result::Result<T, String>;

impl SphereJson {
    fn primitive(&self) -> Checked<Primitive> {
        Ok(Primitive::Sphere {
            center: place("center", self.center)?,
            radius: size("radius", self.radius)?,
        })
    }
}

impl CuboidJson {
    fn primitive(&self) -> Checked<Primitive> {
        let world_from_box = pose(self.center, self.rotation_xyzw)?;
        self.half_extents.iter().try_for_each(|half| size("half_extents", *half).map(drop))?;
        Ok(Primitive::Cuboid { world_from_box, half_extents: Vec3::from_array(self.half_extents) })
    }
}

impl CapsuleJson {
    fn primitive(&self) -> Checked<Primitive> {
        Ok(Primitive::Capsule {
            a: place("a", self.a)?,
            b: place("b", self.b)?,
            radius: size("radius", self.radius)?,
        })
    }
}

impl CylinderJson {
    fn primitive(&self) -> Checked<Primitive> {
        Ok(Primitive::Cylinder {
            world_from_cylinder: pose(self.center, self.rotation_xyzw)?,
            radius: size("radius", self.radius)?,
            half_length: size("half_length", self.half_length)?,
        })
    }
}

fn pose(center: [f32; 3], rotation_xyzw: [f64; 4]) -> Checked<Pose3> {
    let rotation =
        unit_quaternion(rotation_xyzw).map_err(|reason| format!("rotation_xyzw: {reason}"))?;
    Ok(Pose3::from_parts(
        place("center", center)?,
        Quat::from_array(rotation.to_array().map(|part| part as f32)),
    ))
}

fn place(field: &str, position: [f32; 3]) -> Checked<Vec3> {
    let is_within = |length: &&f32| length.is_finite() && length.abs() <= MAX_LENGTH;
    match position.iter().find(|length| !is_within(length)) {
        Some(length) => {
            Err(format!("{field}: has {length}, expected -{MAX_LENGTH} to {MAX_LENGTH}"))
        }
        None => Ok(Vec3::from_array(position)),
    }
}

fn size(field: &str, length: f32) -> Checked<f32> {
    if (0.0..=MAX_LENGTH).contains(&length) {
        Ok(length)
    } else {
        Err(format!("{field}: is {length}, expected 0 to {MAX_LENGTH}"))
    }
}

#[cfg(test)]
mod tests;
