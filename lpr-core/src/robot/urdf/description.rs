//! The links and joints of a URDF, read one by one: what an element says is checked here, how they
//! hang together is not.

use crate::error::Result;
use crate::robot::JointMotion;
use crate::robot::fit::Solid;
use crate::robot::mesh::{self, MeshReader};
use crate::robot::xml::{
    Node, attribute, child, children, fault, lengths, needed_child, number, numbers, quoted, sizes,
};
use core::f64::consts::TAU;
use glamx::{DPose3, DQuat, DVec3};
use std::collections::BTreeMap;

/// Velocity limit of a continuous joint that states none: slow enough for any arm, rad/s.
const CONTINUOUS_MAX_VELOCITY: f32 = 1.0;
/// Length of an axis below which it has no direction.
const MIN_AXIS: f64 = 1e-6;

/// A robot as its file lists it.
#[derive(Debug)]
pub(super) struct Description {
    pub(super) name: String,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
    /// Index into `links` by name.
    pub(super) link_by_name: BTreeMap<String, usize>,
}

#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) collisions: Vec<Collision>,
}

/// A solid of a link.
#[derive(Debug)]
pub(super) struct Collision {
    pub(super) link_from_solid: DPose3,
    pub(super) solid: Solid,
}

#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    /// Index of the link that the joint hangs on.
    pub(super) parent: usize,
    /// Index of the link that it carries.
    pub(super) child: usize,
    pub(super) parent_from_joint: DPose3,
    pub(super) mobility: Mobility,
}

/// Kind of a joint by its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mobility {
    Fixed,
    /// By its own motor.
    Driven(Drive),
    /// As another joint does.
    Mimic(Drive),
    /// In more than one direction: floating and planar joints.
    Free,
}

/// Axis (of length 1, in the joint's frame) and limits of a joint that turns or slides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drive {
    pub(super) motion: JointMotion,
    pub(super) axis: DVec3,
    pub(super) lower: f32,
    pub(super) upper: f32,
    /// Turns without end; the limits are a turn either way.
    pub(super) is_continuous: bool,
    pub(super) max_velocity: f32,
}

impl Description {
    /// Links first, since joints name them.
    pub(super) fn read(robot: Node<'_>, meshes: &MeshReader<'_>) -> Result<Self> {
        let (mut links, mut link_by_name) = (Vec::new(), BTreeMap::new());
        for node in children(robot, "link") {
            let name = attribute(node, "name")?.to_owned();
            if link_by_name.insert(name.clone(), links.len()).is_some() {
                return Err(fault(node, "a second link of that name"));
            }
            let collisions =
                children(node, "collision").map(|collision| read_collision(collision, meshes));
            links.push(Link { name, collisions: collisions.collect::<Result<_>>()? });
        }
        if links.is_empty() {
            return Err(fault(robot, "it has no <link>"));
        }
        let joints = read_joints(robot, &link_by_name)?;
        let name = robot.attribute("name").unwrap_or("robot").to_owned();
        Ok(Self { name, links, joints, link_by_name })
    }
}

fn read_joints(robot: Node<'_>, link_by_name: &BTreeMap<String, usize>) -> Result<Vec<Joint>> {
    let (mut joints, mut line_by_name) = (Vec::new(), BTreeMap::new());
    for node in children(robot, "joint") {
        let name = attribute(node, "name")?;
        if line_by_name.insert(name, node).is_some() {
            return Err(fault(node, "a second joint of that name"));
        }
        joints.push(read_joint(node, name, link_by_name)?);
    }
    Ok(joints)
}

fn read_joint(node: Node<'_>, name: &str, link_by_name: &BTreeMap<String, usize>) -> Result<Joint> {
    let link = |tag| {
        let end = needed_child(node, tag)?;
        let link = attribute(end, "link")?;
        link_by_name
            .get(link)
            .copied()
            .ok_or_else(|| fault(end, &format!("there is no link {}", quoted(link))))
    };
    let (parent, child) = (link("parent")?, link("child")?);
    Ok(Joint {
        name: name.to_owned(),
        parent,
        child,
        parent_from_joint: origin(node)?,
        mobility: mobility(node)?,
    })
}

fn mobility(node: Node<'_>) -> Result<Mobility> {
    let mimic = child(node, "mimic")?;
    let kind = attribute(node, "type")?;
    let limits = match kind {
        "fixed" => return Ok(Mobility::Fixed),
        "floating" | "planar" => return Ok(Mobility::Free),
        "revolute" => (JointMotion::Turn, needed_limits(node, mimic)?),
        "prismatic" => (JointMotion::Slide, needed_limits(node, mimic)?),
        "continuous" => (JointMotion::Turn, continuous_limits(node)?),
        other => return Err(fault(node, &format!("unknown type {}", quoted(other)))),
    };
    let (motion, Limits { lower, upper, max_velocity }) = limits;
    let is_continuous = kind == "continuous";
    let drive = Drive { motion, axis: axis(node)?, lower, upper, is_continuous, max_velocity };
    Ok(if mimic.is_some() { Mobility::Mimic(drive) } else { Mobility::Driven(drive) })
}

/// Positions in radians or metres, velocity in those per second.
struct Limits {
    lower: f32,
    upper: f32,
    max_velocity: f32,
}

/// A joint that follows another may leave its limits to that one.
fn needed_limits(node: Node<'_>, mimic: Option<Node<'_>>) -> Result<Limits> {
    if mimic.is_some() && child(node, "limit")?.is_none() {
        return Ok(Limits { lower: 0.0, upper: 0.0, max_velocity: 0.0 });
    }
    let limit = needed_child(node, "limit")?;
    let (lower, upper) = (number(limit, "lower")?, number(limit, "upper")?);
    if lower.is_none() && upper.is_none() {
        return Err(fault(limit, "'lower' and 'upper' are missing"));
    }
    // Either may be left out where it is 0.
    let (lower, upper) = (lower.unwrap_or(0.0), upper.unwrap_or(0.0));
    if lower > upper {
        return Err(fault(limit, &format!("'lower' {lower} is above 'upper' {upper}")));
    }
    attribute(limit, "velocity")?;
    Ok(Limits {
        lower: lower as f32,
        upper: upper as f32,
        max_velocity: velocity(limit)?.unwrap_or(0.0),
    })
}

/// One turn either way: further windings lead to the same poses.
fn continuous_limits(node: Node<'_>) -> Result<Limits> {
    let max_velocity = child(node, "limit")?.map(velocity).transpose()?.flatten();
    let max_velocity = max_velocity.unwrap_or(CONTINUOUS_MAX_VELOCITY);
    Ok(Limits { lower: -TAU as f32, upper: TAU as f32, max_velocity })
}

fn velocity(limit: Node<'_>) -> Result<Option<f32>> {
    let found = number(limit, "velocity")?;
    match found {
        Some(velocity) if velocity as f32 <= 0.0 => {
            Err(fault(limit, &format!("'velocity' must be positive, not {velocity}")))
        }
        _ => Ok(found.map(|velocity| velocity as f32)),
    }
}

/// The axis at length 1; x where none is stated.
fn axis(joint: Node<'_>) -> Result<DVec3> {
    let Some(node) = child(joint, "axis")? else { return Ok(DVec3::X) };
    attribute(node, "xyz")?;
    let axis = numbers::<3>(node, "xyz")?.map_or(DVec3::X, DVec3::from_array);
    let length = libm::sqrt(axis.dot(axis));
    if length < MIN_AXIS {
        return Err(fault(node, "a joint that moves needs an axis other than 0 0 0"));
    }
    Ok(axis / length)
}

/// The pose of `<origin>`: fixed angles roll, pitch, yaw about x, y, z in that order.
fn origin(node: Node<'_>) -> Result<DPose3> {
    let Some(origin) = child(node, "origin")? else { return Ok(DPose3::IDENTITY) };
    let at = lengths::<3>(origin, "xyz")?.unwrap_or([0.0; 3]);
    let [roll, pitch, yaw] = numbers::<3>(origin, "rpy")?.unwrap_or([0.0; 3]);
    let about = |axis: DVec3, angle: f64| {
        let (sin, cos) = libm::sincos(0.5 * angle);
        DQuat::from_xyzw(sin * axis.x, sin * axis.y, sin * axis.z, cos)
    };
    let rotation = about(DVec3::Z, yaw) * about(DVec3::Y, pitch) * about(DVec3::X, roll);
    Ok(DPose3::from_parts(DVec3::from_array(at), rotation))
}

fn read_collision(node: Node<'_>, meshes: &MeshReader<'_>) -> Result<Collision> {
    let link_from_solid = origin(node)?;
    let geometry = needed_child(node, "geometry")?;
    let mut elements = geometry.children().filter(|it| it.is_element());
    let shape = elements.next().ok_or_else(|| fault(geometry, "it is empty"))?;
    match elements.next() {
        Some(second) => Err(fault(second, "a second shape in one <geometry>")),
        None => Ok(Collision { link_from_solid, solid: solid(shape, meshes)? }),
    }
}

/// Cylinders and capsules lie along z; the length of a capsule is that of its axis.
fn solid(node: Node<'_>, meshes: &MeshReader<'_>) -> Result<Solid> {
    let single = |name| sizes::<1>(node, name).map(|[size]| size);
    Ok(match node.tag_name().name() {
        "sphere" => Solid::Ball { radius: single("radius")? },
        "box" => Solid::Cuboid { half_extents: 0.5 * DVec3::from_array(sizes(node, "size")?) },
        "cylinder" => {
            Solid::Cylinder { radius: single("radius")?, half_length: 0.5 * single("length")? }
        }
        "capsule" => {
            Solid::Capsule { radius: single("radius")?, half_length: 0.5 * single("length")? }
        }
        "mesh" => {
            let scale = numbers::<3>(node, "scale")?.map_or(DVec3::ONE, DVec3::from_array);
            let triangles = mesh::read(attribute(node, "filename")?, scale, meshes);
            Solid::Mesh { triangles: triangles.map_err(|message| fault(node, &message))? }
        }
        other => return Err(fault(node, &format!("unknown geometry {}", quoted(other)))),
    })
}
