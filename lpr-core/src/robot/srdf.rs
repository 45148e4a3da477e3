//! The parts of an SRDF that a URDF lacks: groups of joints, and which pairs of links are tested.
//! By name: what the URDF does not have is told where the names are looked up.

use super::Result;
use super::xml::{self, Node, attribute, children};

/// The parts of an SRDF that are read.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(super) struct Semantics {
    /// In the order of the file.
    pub(super) groups: Vec<Group>,
    /// Pairs of `disable_collisions`.
    pub(super) disabled: Vec<Pair>,
    /// Links of `disable_default_collisions`: no pair with them is tested unless it is enabled.
    pub(super) disabled_by_default: Vec<String>,
    /// Pairs of `enable_collisions`.
    pub(super) enabled: Vec<Pair>,
}

/// Names of two links.
pub(super) type Pair = [String; 2];

/// A group of joints, by what the file lists in it.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(super) struct Group {
    pub(super) name: String,
    /// Base and tip of each `chain`.
    pub(super) chains: Vec<Pair>,
    pub(super) joints: Vec<String>,
    /// Links, which stand for the joints that carry them.
    pub(super) links: Vec<String>,
    /// Names of other groups.
    pub(super) subgroups: Vec<String>,
}

impl Semantics {
    /// Reads the file. Names are checked where they are used.
    pub(super) fn read(text: &str) -> Result<Self> {
        let text = xml::with_prefixes(text);
        let document = xml::parse("SRDF", &text)?;
        let robot = xml::robot("SRDF", &document)?;
        let pairs = |tag| children(robot, tag).map(|node| pair(node, "link1", "link2"));
        // A group that is mentioned within a state or an end effector is no definition.
        Ok(Self {
            groups: children(robot, "group").map(group).collect::<Result<_>>()?,
            disabled: pairs("disable_collisions").collect::<Result<_>>()?,
            disabled_by_default: names(robot, "disable_default_collisions", "link")?,
            enabled: pairs("enable_collisions").collect::<Result<_>>()?,
        })
    }
}

fn group(node: Node<'_>) -> Result<Group> {
    let chains = children(node, "chain").map(|chain| pair(chain, "base_link", "tip_link"));
    Ok(Group {
        name: attribute(node, "name")?.to_owned(),
        chains: chains.collect::<Result<_>>()?,
        joints: names(node, "joint", "name")?,
        links: names(node, "link", "name")?,
        subgroups: names(node, "group", "name")?,
    })
}

fn pair(node: Node<'_>, first: &str, second: &str) -> Result<Pair> {
    Ok([attribute(node, first)?.to_owned(), attribute(node, second)?.to_owned()])
}

fn names(node: Node<'_>, tag: &str, name: &str) -> Result<Vec<String>> {
    children(node, tag).map(|it| attribute(it, name).map(str::to_owned)).collect()
}
