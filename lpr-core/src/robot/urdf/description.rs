//! The links and joints of a URDF, read one by one: what an element says is checked here, how they
//! hang together is not.

use crate::error::{Error, Result};
use crate::robot::JointMotion;
use crate::robot::mesh::{self, MeshReader};
use crate::robot::solid::Solid;
use crate::robot::xml::{
    Node, attribute, child, children, fault, lengths, line_of, needed_child, number, numbers,
    quoted, sizes,
};
use glamx::{DPose3, DQuat, DVec3};
use std::collections::BTreeMap;

/// Velocity limit of a joint that states none above 0: slow enough for any arm, rad/s or m/s.
const DEFAULT_MAX_VELOCITY: f32 = 1.0;
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
    pub(super) shape: Shape,
}

/// The geometry of a solid as the file states it.
#[derive(Debug)]
pub(super) enum Shape {
    Solid(Solid),
    /// A mesh, which is opened where collisions are asked for.
    Mesh(MeshFile),
}

/// A mesh by its file.
#[derive(Debug)]
pub(super) struct MeshFile {
    /// As it stands in the description.
    pub(super) file: String,
    pub(super) scale: DVec3,
    /// Line of the element.
    line: u32,
}

impl MeshFile {
    /// Its triangles, metres.
    pub(super) fn read(&self, meshes: &MeshReader<'_>) -> Result<Solid, String> {
        mesh::read(&self.file, self.scale, meshes)
            .map(|triangles| Solid::Mesh { triangles })
            .map_err(|message| format!("<mesh> on line {}: {message}", self.line))
    }
}

/// A joint. What is wrong with its motion matters only where it moves: between base and tip.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    /// Index of the link that the joint hangs on.
    pub(super) parent: usize,
    /// Index of the link that it carries.
    pub(super) child: usize,
    pub(super) parent_from_joint: DPose3,
    pub(super) mobility: Mobility,
    /// Why it cannot be an arm's joint: its axis, limits or velocity.
    pub(super) fault: Option<Error>,
    /// What it states of its velocity is no limit: another is taken.
    pub(super) lacks_velocity: bool,
}

/// Kind of a joint by its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mobility {
    Fixed,
    /// By its own motor.
    Driven(Drive),
    /// As another joint does.
    Mimic(Drive, Mimic),
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
    /// Turns without end; the limits are infinite.
    pub(super) is_continuous: bool,
    pub(super) max_velocity: f32,
}

/// The position of a joint that follows: `multiplier` times that of joint `driver`, and `offset`
/// (radians or metres). The driver has a motor of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mimic {
    pub(super) driver: usize,
    pub(super) multiplier: f64,
    pub(super) offset: f64,
}

impl Description {
    /// Links first, since joints name them.
    pub(super) fn read(robot: Node<'_>, limit_continuous: bool) -> Result<Self> {
        let (mut links, mut link_by_name) = (Vec::new(), BTreeMap::new());
        for node in children(robot, "link") {
            let name = attribute(node, "name")?.to_owned();
            if link_by_name.insert(name.clone(), links.len()).is_some() {
                return Err(fault(node, "a second link of that name"));
            }
            let collisions = children(node, "collision").map(read_collision);
            links.push(Link { name, collisions: collisions.collect::<Result<_>>()? });
        }
        if links.is_empty() {
            return Err(fault(robot, "it has no <link>"));
        }
        let joints = read_joints(robot, &link_by_name, limit_continuous)?;
        let name = robot.attribute("name").unwrap_or("robot").to_owned();
        Ok(Self { name, links, joints, link_by_name })
    }
}

fn read_joints(
    robot: Node<'_>,
    link_by_name: &BTreeMap<String, usize>,
    limit_continuous: bool,
) -> Result<Vec<Joint>> {
    let (mut joints, mut joint_by_name, mut mimics) = (Vec::new(), BTreeMap::new(), Vec::new());
    for node in children(robot, "joint") {
        let name = attribute(node, "name")?;
        if joint_by_name.insert(name, joints.len()).is_some() {
            return Err(fault(node, "a second joint of that name"));
        }
        mimics.extend(child(node, "mimic")?.map(|mimic| (joints.len(), mimic)));
        joints.push(read_joint(node, name, link_by_name, limit_continuous)?);
    }
    follow(&mut joints, &joint_by_name, &mimics)?;
    Ok(joints)
}

/// Makes each joint with a `<mimic>` follow the joint with a motor at the end of its chain of
/// followers.
fn follow(
    joints: &mut [Joint],
    joint_by_name: &BTreeMap<&str, usize>,
    mimics: &[(usize, Node<'_>)],
) -> Result<()> {
    // Index of the joint that is followed, multiplier and offset, by the joint that follows.
    let mut followed = BTreeMap::new();
    for &(joint, node) in mimics {
        let name = attribute(node, "joint")?;
        let Some(&driver) = joint_by_name.get(name) else {
            // It stands still; between base and tip that is an error.
            joints[joint].fault = Some(fault(node, &format!("there is no joint {}", quoted(name))));
            joints[joint].mobility = Mobility::Fixed;
            continue;
        };
        let multiplier = number(node, "multiplier")?.unwrap_or(1.0);
        let offset = number(node, "offset")?.unwrap_or(0.0);
        followed.insert(joint, Mimic { driver, multiplier, offset });
    }
    for &(joint, node) in mimics {
        let Some(&(mut mimic)) = followed.get(&joint) else { continue };
        let mut n_left = mimics.len();
        while let Some(next) = followed.get(&mimic.driver) {
            mimic = Mimic {
                driver: next.driver,
                multiplier: mimic.multiplier * next.multiplier,
                offset: mimic.multiplier * next.offset + mimic.offset,
            };
            n_left -= 1;
            if n_left == 0 {
                return Err(fault(node, "it follows itself: a loop"));
            }
        }
        if let Mobility::Driven(drive) = joints[joint].mobility {
            joints[joint].mobility = Mobility::Mimic(drive, mimic);
        }
    }
    Ok(())
}

fn read_joint(
    node: Node<'_>,
    name: &str,
    link_by_name: &BTreeMap<String, usize>,
    limit_continuous: bool,
) -> Result<Joint> {
    let link = |tag| {
        let end = needed_child(node, tag)?;
        let link = attribute(end, "link")?;
        link_by_name
            .get(link)
            .copied()
            .ok_or_else(|| fault(end, &format!("there is no link {}", quoted(link))))
    };
    let (parent, child) = (link("parent")?, link("child")?);
    let (mobility, fault) = mobility(node, limit_continuous)?;
    let lacks_velocity =
        self::child(node, "limit")?.is_some_and(|limit| matches!(velocity(limit), Ok(None)));
    Ok(Joint {
        name: name.to_owned(),
        parent,
        child,
        parent_from_joint: origin(node)?,
        mobility,
        fault,
        lacks_velocity,
    })
}

/// The motion of a joint, and what is wrong with it: with a fault, its range is 0 alone.
fn mobility(node: Node<'_>, limit_continuous: bool) -> Result<(Mobility, Option<Error>)> {
    let kind = attribute(node, "type")?;
    let motion = match kind {
        "fixed" => return Ok((Mobility::Fixed, None)),
        "floating" | "planar" => return Ok((Mobility::Free, None)),
        "revolute" | "continuous" => JointMotion::Turn,
        "prismatic" => JointMotion::Slide,
        other => return Err(fault(node, &format!("unknown type {}", quoted(other)))),
    };
    let states_limits = child(node, "limit")?
        .is_some_and(|limit| limit.has_attribute("lower") && limit.has_attribute("upper"));
    let is_continuous = kind == "continuous" && !(limit_continuous && states_limits);
    let is_mimic = child(node, "mimic")?.is_some();
    let limits =
        if is_continuous { continuous_limits(node) } else { needed_limits(node, is_mimic) };
    let (limits, limits_fault) = match limits {
        Ok(limits) => (limits, None),
        Err(fault) => (Limits { lower: 0.0, upper: 0.0, max_velocity: 0.0 }, Some(fault)),
    };
    let (axis, axis_fault) = match axis(node) {
        Ok(axis) => (axis, None),
        Err(fault) => (DVec3::X, Some(fault)),
    };
    let Limits { lower, upper, max_velocity } = limits;
    let drive = Drive { motion, axis, lower, upper, is_continuous, max_velocity };
    Ok((Mobility::Driven(drive), axis_fault.or(limits_fault)))
}

/// Positions in radians or metres, velocity in those per second.
struct Limits {
    lower: f32,
    upper: f32,
    max_velocity: f32,
}

/// A joint that follows another may leave its limits to that one.
fn needed_limits(node: Node<'_>, is_mimic: bool) -> Result<Limits> {
    if is_mimic && child(node, "limit")?.is_none() {
        return Ok(Limits { lower: 0.0, upper: 0.0, max_velocity: 0.0 });
    }
    let limit = needed_child(node, "limit")?;
    // Either may be left out where it is 0; so may both, and then the joint stands still.
    let lower = number(limit, "lower")?.unwrap_or(0.0);
    let upper = number(limit, "upper")?.unwrap_or(0.0);
    if lower > upper {
        return Err(fault(limit, &format!("'lower' {lower} is above 'upper' {upper}")));
    }
    let max_velocity = velocity(limit)?.unwrap_or(DEFAULT_MAX_VELOCITY);
    Ok(Limits { lower: lower as f32, upper: upper as f32, max_velocity })
}

/// Of the position none: limits that are stated beside are those of another kind of joint.
fn continuous_limits(node: Node<'_>) -> Result<Limits> {
    let max_velocity = child(node, "limit")?.map(velocity).transpose()?.flatten();
    let max_velocity = max_velocity.unwrap_or(DEFAULT_MAX_VELOCITY);
    Ok(Limits { lower: f32::NEG_INFINITY, upper: f32::INFINITY, max_velocity })
}

fn velocity(limit: Node<'_>) -> Result<Option<f32>> {
    let found = number(limit, "velocity")?.map(|velocity| velocity as f32);
    Ok(found.filter(|velocity| *velocity > 0.0))
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

fn read_collision(node: Node<'_>) -> Result<Collision> {
    let link_from_solid = origin(node)?;
    let geometry = needed_child(node, "geometry")?;
    let mut elements = geometry.children().filter(|it| it.is_element());
    let shape = elements.next().ok_or_else(|| fault(geometry, "it is empty"))?;
    match elements.next() {
        Some(second) => Err(fault(second, "a second shape in one <geometry>")),
        None => Ok(Collision { link_from_solid, shape: read_shape(shape)? }),
    }
}

/// Cylinders and capsules lie along z; the length of a capsule is that of its axis.
fn read_shape(node: Node<'_>) -> Result<Shape> {
    let single = |name| sizes::<1>(node, name).map(|[size]| size);
    Ok(Shape::Solid(match node.tag_name().name() {
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
            let file = attribute(node, "filename")?.to_owned();
            return Ok(Shape::Mesh(MeshFile { file, scale, line: line_of(node) }));
        }
        other => return Err(fault(node, &format!("unknown geometry {}", quoted(other)))),
    }))
}
