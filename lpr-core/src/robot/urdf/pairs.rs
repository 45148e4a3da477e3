//! The pairs of links that are never tested against each other.

use crate::robot::Robot;
use crate::robot::srdf::{Pair, Semantics};
use crate::robot::xml::quoted;
use std::collections::{BTreeMap, BTreeSet};

/// Unknown names that a warning lists at most.
const MAX_LISTED: usize = 4;

/// Pairs `a < b` of indices of links, sorted: with an SRDF those that it disables, without one those
/// of neighbouring bodies; of one body always.
pub(super) fn allowed(
    robot: &Robot,
    semantics: Option<&Semantics>,
    link_by_name: &BTreeMap<String, usize>,
    warnings: &mut Vec<String>,
) -> Vec<(usize, usize)> {
    let links = &robot.links;
    let solid: Vec<usize> =
        (0..links.len()).filter(|&link| !links[link].spheres.is_empty()).collect();
    let mut stands_on = vec![None; robot.n_bodies()];
    robot.moves().iter().for_each(|step| stands_on[step.body] = Some(step.parent));
    let near = |&(a, b): &(usize, usize)| {
        let (a, b) = (links[a].body, links[b].body);
        let are_neighbours = stands_on[a] == Some(b) || stands_on[b] == Some(a);
        a == b || (semantics.is_none() && are_neighbours)
    };
    let mut allowed: BTreeSet<_> = pairs(&solid).filter(near).collect();
    let Some(semantics) = semantics else { return allowed.into_iter().collect() };
    let mut unknown = BTreeSet::new();
    let mut link = |name: &str| {
        let found = link_by_name.get(name).copied();
        if found.is_none() {
            unknown.insert(name.to_owned());
        }
        found
    };
    let mut pair = |names: &Pair| {
        let [a, b] = [link(&names[0]), link(&names[1])];
        a.zip(b).map(|(a, b)| (a.min(b), a.max(b)))
    };
    let disabled: Vec<_> = semantics.disabled.iter().filter_map(&mut pair).collect();
    let enabled: Vec<_> = semantics.enabled.iter().filter_map(&mut pair).collect();
    let alone: Vec<_> =
        semantics.disabled_by_default.iter().filter_map(|name| link(name)).collect();
    let is_alone = |&(a, b): &(usize, usize)| alone.contains(&a) || alone.contains(&b);
    allowed.extend(pairs(&solid).filter(is_alone));
    allowed.retain(|pair| !enabled.contains(pair));
    let is_pair = |&(a, b): &(usize, usize)| {
        a != b && solid.binary_search(&a).is_ok() && solid.binary_search(&b).is_ok()
    };
    allowed.extend(disabled.into_iter().filter(is_pair));
    if !unknown.is_empty() {
        let names: Vec<String> = unknown.iter().take(MAX_LISTED).map(|name| quoted(name)).collect();
        let more = if unknown.len() > MAX_LISTED { " and others" } else { "" };
        warnings.push(format!(
            "SRDF: {} links that the URDF does not have: {}{more}",
            unknown.len(),
            names.join(", ")
        ));
    }
    allowed.into_iter().collect()
}

/// Pairs of different links, in order.
fn pairs(links: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
    links.iter().enumerate().flat_map(|(i, &a)| links[i + 1..].iter().map(move |&b| (a, b)))
}
