//! Elements and attributes of robot descriptions, with errors that name the element at fault.

use super::{Error, Result};
use roxmltree::Document;

/// An element of a document.
pub(super) type Node<'a> = roxmltree::Node<'a, 'a>;

/// Largest length in a description, metres: what is larger is a unit gone wrong, and would lose
/// precision in f32.
pub(super) const MAX_LENGTH: f64 = 1000.0;

/// Characters of a name or value that a message repeats.
const MAX_QUOTED: usize = 60;

/// The document in `text`; `what` is URDF or SRDF.
pub(super) fn parse<'a>(what: &str, text: &'a str) -> Result<Document<'a>> {
    Document::parse(text)
        .map_err(|error| Error::Robot(format!("{what}, line {}: {error}", error.pos().row)))
}

/// The `<robot>` of a document in which no macro is left.
pub(super) fn robot<'a>(what: &str, document: &'a Document<'a>) -> Result<Node<'a>> {
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(fault(root, &format!("{what}: the outermost element is not <robot>")));
    }
    match document
        .descendants()
        .find(|node| node.tag_name().namespace().is_some_and(|name| name.contains("xacro")))
    {
        Some(node) => {
            Err(fault(node, "a macro that is not expanded: run the file through xacro first"))
        }
        None => Ok(root),
    }
}

/// The error `message` about an element, with its line and the link or joint that it belongs to.
pub(super) fn fault(node: Node<'_>, message: &str) -> Error {
    let tag = node.tag_name().name();
    let line = node.document().text_pos_at(node.range().start).row;
    let owner = node.ancestors().find_map(|it| {
        let kind = it.tag_name().name();
        let name = it.attribute("name").filter(|_| ["link", "joint", "group"].contains(&kind))?;
        Some(format!("{kind} {}, ", quoted(name)))
    });
    Error::Robot(format!("{}<{tag:.60}> on line {line}: {message}", owner.unwrap_or_default()))
}

/// A name or value in quotes, cut if it is long.
pub(super) fn quoted(value: &str) -> String {
    let is_long = value.chars().nth(MAX_QUOTED).is_some();
    format!("'{value:.MAX_QUOTED$}{}'", if is_long { "…" } else { "" })
}

/// The elements of that name directly below `node`.
pub(super) fn children<'a>(node: Node<'a>, tag: &str) -> impl Iterator<Item = Node<'a>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == tag)
}

/// The element of that name directly below `node`, of which there may be one.
pub(super) fn child<'a>(node: Node<'a>, tag: &str) -> Result<Option<Node<'a>>> {
    let mut found = children(node, tag);
    let first = found.next();
    match found.next() {
        Some(second) => Err(fault(second, &format!("a second <{tag}>"))),
        None => Ok(first),
    }
}

/// The element of that name directly below `node`, of which there must be one.
pub(super) fn needed_child<'a>(node: Node<'a>, tag: &str) -> Result<Node<'a>> {
    child(node, tag)?.ok_or_else(|| fault(node, &format!("<{tag}> is missing")))
}

/// An attribute that must be there and not be empty.
pub(super) fn attribute<'a>(node: Node<'a>, name: &str) -> Result<&'a str> {
    match node.attribute(name) {
        Some("") => Err(fault(node, &format!("'{name}' is empty"))),
        Some(value) => Ok(value),
        None => Err(fault(node, &format!("'{name}' is missing"))),
    }
}

/// The numbers of an attribute, if it is there; finite as f32, too.
pub(super) fn numbers<const N: usize>(node: Node<'_>, name: &str) -> Result<Option<[f64; N]>> {
    let Some(text) = node.attribute(name) else { return Ok(None) };
    let parsed: core::result::Result<Vec<f64>, _> =
        text.split_whitespace().take(N + 1).map(str::parse).collect();
    let is_whole = |found: &[f64]| found.iter().all(|x| (*x as f32).is_finite());
    match parsed {
        Ok(found) if !is_whole(&found) => {
            Err(fault(node, &format!("'{name}' is not finite: {}", quoted(text))))
        }
        Ok(found) => {
            let wrong =
                |_| fault(node, &format!("'{name}' needs {N} numbers, not {}", quoted(text)));
            found.try_into().map(Some).map_err(wrong)
        }
        Err(_) => Err(fault(node, &format!("'{name}' is not made of numbers: {}", quoted(text)))),
    }
}

/// The number of an attribute, if it is there.
pub(super) fn number(node: Node<'_>, name: &str) -> Result<Option<f64>> {
    Ok(numbers::<1>(node, name)?.map(|[x]| x))
}

/// Lengths of an attribute in metres, if it is there.
pub(super) fn lengths<const N: usize>(node: Node<'_>, name: &str) -> Result<Option<[f64; N]>> {
    let found = numbers::<N>(node, name)?;
    if found.is_some_and(|found| found.iter().any(|x| x.abs() > MAX_LENGTH)) {
        return Err(fault(
            node,
            &format!("'{name}' is more than {MAX_LENGTH} m: lengths are in metres"),
        ));
    }
    Ok(found)
}

/// Lengths of an attribute that must be there and positive, metres.
pub(super) fn sizes<const N: usize>(node: Node<'_>, name: &str) -> Result<[f64; N]> {
    attribute(node, name)?;
    let found = lengths::<N>(node, name)?.unwrap_or([0.0; N]);
    if found.iter().any(|x| *x as f32 <= 0.0) {
        return Err(fault(
            node,
            &format!("'{name}' must be positive: {}", quoted(attribute(node, name)?)),
        ));
    }
    Ok(found)
}
