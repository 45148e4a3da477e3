//! The groups of an SRDF on the tree of a URDF: which are chains, and their ends.

use super::description::{Description, Mobility};
use super::tree::Tree;
use crate::error::{Error, Result};
use crate::robot::srdf::{Group, Semantics};
use crate::robot::xml::quoted;
use std::collections::BTreeSet;

/// Groups within groups that are followed: a group that contains itself ends here.
const MAX_DEPTH: usize = 16;

/// A group whose moving joints are one after the other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Chain {
    pub(super) name: String,
    /// Indices of the links at its ends.
    pub(super) base: usize,
    pub(super) tip: usize,
    /// Number of joints with a motor of their own.
    pub(super) n_driven: usize,
}

/// The group of that name, which must be a chain.
pub(super) fn named(
    description: &Description,
    tree: &Tree,
    semantics: &Semantics,
    name: &str,
) -> Result<Chain> {
    let Some(group) = semantics.groups.iter().find(|group| group.name == name) else {
        let known: Vec<String> = semantics.groups.iter().map(|group| quoted(&group.name)).collect();
        return Err(Error::Robot(format!(
            "group: expected one of {}, found {}",
            known.join(", "),
            quoted(name)
        )));
    };
    chain(description, tree, semantics, group)
        .map_err(|reason| Error::Robot(format!("group {}: {reason}", quoted(name))))
}

/// All groups that are chains, in the order of the file.
pub(super) fn chains(description: &Description, tree: &Tree, semantics: &Semantics) -> Vec<Chain> {
    let groups = semantics.groups.iter();
    groups.filter_map(|group| chain(description, tree, semantics, group).ok()).collect()
}

/// The chain with the most driven joints, the first of several.
pub(super) fn longest(chains: &[Chain]) -> Option<&Chain> {
    chains.iter().rev().max_by_key(|chain| chain.n_driven)
}

/// The chain that a group is, or why it is none.
fn chain(
    description: &Description,
    tree: &Tree,
    semantics: &Semantics,
    group: &Group,
) -> Result<Chain, String> {
    let mut joints = BTreeSet::new();
    collect(description, tree, semantics, group, &mut joints, MAX_DEPTH)?;
    let is_driven =
        |joint: &usize| matches!(description.joints[*joint].mobility, Mobility::Driven(_));
    let n_driven = joints.iter().filter(|joint| is_driven(joint)).count();
    if n_driven == 0 {
        return Err("no joint of it moves".to_owned());
    }
    // The deepest joint of the group, from which all others are upwards.
    let depth = |joint: usize| tree.depth[description.joints[joint].child];
    let Some(&deepest) = joints.iter().max_by_key(|&&joint| depth(joint)) else {
        return Err("it is empty".to_owned());
    };
    let mut way = Vec::new();
    let mut link = description.joints[deepest].child;
    while let Some(joint) = tree.joint_above[link] {
        way.push(joint);
        link = description.joints[joint].parent;
    }
    let highest = way.iter().rposition(|joint| joints.contains(joint)).unwrap_or(0);
    let within = &way[..=highest];
    if let Some(beside) = joints.iter().find(|joint| is_driven(joint) && !within.contains(joint)) {
        let name = |joint: usize| quoted(&description.joints[joint].name);
        return Err(format!(
            "it is no chain: joints {} and {} are beside each other",
            name(*beside),
            name(deepest)
        ));
    }
    if let Some(left_out) = within.iter().find(|joint| is_driven(joint) && !joints.contains(joint))
    {
        return Err(format!("it leaves out joint {}", quoted(&description.joints[*left_out].name)));
    }
    let ends = match (
        &group.chains[..],
        group.joints.is_empty() && group.links.is_empty() && group.subgroups.is_empty(),
    ) {
        ([[base, tip]], true) => description
            .link_by_name
            .get(base)
            .copied()
            .zip(description.link_by_name.get(tip).copied()),
        _ => None,
    };
    let (base, tip) = ends
        .unwrap_or((description.joints[way[highest]].parent, description.joints[deepest].child));
    Ok(Chain { name: group.name.clone(), base, tip, n_driven })
}

/// Adds the joints of a group: between the ends of its chains, those that it lists, those that carry
/// the links that it lists, and those of the groups in it.
fn collect(
    description: &Description,
    tree: &Tree,
    semantics: &Semantics,
    group: &Group,
    joints: &mut BTreeSet<usize>,
    depth: usize,
) -> Result<(), String> {
    let link = |name: &str| {
        let found = description.link_by_name.get(name).copied();
        found.ok_or_else(|| format!("the URDF has no link {}", quoted(name)))
    };
    for [base, tip] in &group.chains {
        let way =
            tree.path(description, link(base)?, link(tip)?).map_err(|error| error.to_string())?;
        joints.extend(way);
    }
    for name in &group.joints {
        let found = description.joints.iter().position(|joint| joint.name == *name);
        match found {
            Some(joint) => drop(joints.insert(joint)),
            // Joints between the world and the robot are the SRDF's own.
            None => return Err(format!("the URDF has no joint {}", quoted(name))),
        }
    }
    for name in &group.links {
        joints.extend(tree.joint_above[link(name)?]);
    }
    for name in &group.subgroups {
        let Some(inner) = semantics.groups.iter().find(|group| group.name == *name) else {
            return Err(format!("there is no group {}", quoted(name)));
        };
        if depth == 0 {
            return Err(format!("group {} contains itself", quoted(name)));
        }
        collect(description, tree, semantics, inner, joints, depth - 1)?;
    }
    Ok(())
}
