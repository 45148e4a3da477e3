//! The parts of an SRDF that a URDF lacks: which links are the arm's ends, and which pairs of links are never
//! tested.

use super::Result;
use super::xml::{self, Node, attribute, children, fault, quoted};
use std::collections::{BTreeMap, BTreeSet};

/// The parts of an SRDF that are read, by indices of links.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Semantics {
    /// Base and tip of the first group that is a chain.
    pub(super) ends: Option<(usize, usize)>,
    /// Pairs of `disable_collisions`, the lower index first.
    pub(super) disabled: BTreeSet<(usize, usize)>,
}

impl Semantics {
    /// Every link that is named must be in the URDF.
    pub(super) fn read(text: &str, link_by_name: &BTreeMap<String, usize>) -> Result<Self> {
        let document = xml::parse("SRDF", text)?;
        let robot = xml::robot("SRDF", &document)?;
        let link = |node, name| link_of(node, name, link_by_name);
        let mut ends = None;
        for group in children(robot, "group") {
            for node in children(group, "link") {
                link(node, "name")?;
            }
            for chain in children(group, "chain") {
                let found = (link(chain, "base_link")?, link(chain, "tip_link")?);
                ends.get_or_insert(found);
            }
        }
        let mut disabled = BTreeSet::new();
        for node in children(robot, "disable_collisions") {
            let (a, b) = (link(node, "link1")?, link(node, "link2")?);
            disabled.insert((a.min(b), a.max(b)));
        }
        Ok(Self { ends, disabled })
    }
}

fn link_of(node: Node<'_>, name: &str, link_by_name: &BTreeMap<String, usize>) -> Result<usize> {
    let link = attribute(node, name)?;
    link_by_name
        .get(link)
        .copied()
        .ok_or_else(|| fault(node, &format!("SRDF: the URDF has no link {}", quoted(link))))
}
