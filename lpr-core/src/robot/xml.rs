//! Elements and attributes of robot descriptions, with errors that name the element at fault.

use super::{Error, Result};
use roxmltree::Document;
use std::borrow::Cow;

/// An element of a document.
pub(super) type Node<'a> = roxmltree::Node<'a, 'a>;

/// Largest length in a description, metres: what is larger is a unit gone wrong, and would lose
/// precision in f32.
pub(super) const MAX_LENGTH: f64 = 1000.0;

/// Characters of a name or value that a message repeats.
const MAX_QUOTED: usize = 60;

/// Most prefixes that are declared for a document that forgot to: each takes another reading.
const MAX_PREFIXES: usize = 16;

/// Text of an XML file: UTF-8, or what its first line says if that is a Latin alphabet of one byte a
/// character. A byte-order mark is left out.
///
/// ```
/// use lpr_core::robot::decode_xml;
///
/// assert_eq!(decode_xml(b"\xef\xbb\xbf<robot/>")?, "<robot/>");
/// let latin = b"<?xml version='1.0' encoding='ISO-8859-1'?><robot name='caf\xe9'/>";
/// assert!(decode_xml(latin)?.ends_with("<robot name='café'/>"));
/// let error = decode_xml(b"<robot\nname='\xe9'/>").unwrap_err().to_string();
/// assert!(error.contains("line 2") && error.contains("UTF-8"), "{error}");
/// # Ok::<(), lpr_core::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::Robot`] naming the line of a byte that is not of the encoding, or the encoding that is
/// not read.
pub fn decode_xml(bytes: &[u8]) -> Result<String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let encoding = stated_encoding(bytes);
    match encoding.as_deref() {
        Some("iso-8859-1" | "latin1" | "iso-8859-15" | "windows-1252") => {
            Ok(bytes.iter().map(|&byte| char::from(byte)).collect())
        }
        None | Some("utf-8" | "utf8" | "us-ascii" | "ascii") => match core::str::from_utf8(bytes) {
            Ok(text) => Ok(text.to_owned()),
            Err(error) => {
                let before = &bytes[..error.valid_up_to()];
                let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
                Err(Error::Robot(format!(
                    "line {line}: expected UTF-8 text, found byte 0x{:02x}",
                    bytes[before.len()]
                )))
            }
        },
        Some(other) => Err(Error::Robot(format!(
            "line 1: expected encoding UTF-8 or ISO-8859-1, found {}",
            quoted(other)
        ))),
    }
}

/// The encoding of `<?xml … encoding="…"?>`, in lower case.
fn stated_encoding(bytes: &[u8]) -> Option<String> {
    let declaration = bytes.strip_prefix(b"<?xml")?;
    let end = declaration.iter().position(|&byte| byte == b'>')?;
    let declaration = String::from_utf8_lossy(&declaration[..end]);
    let (_, after) = declaration.split_once("encoding")?;
    let after = after.trim_start().strip_prefix('=')?.trim_start();
    let quote = after.chars().next()?;
    after[1..].split(quote).next().map(str::to_ascii_lowercase)
}

/// `text` with a declaration of every prefix of an element or attribute that has none: tags of
/// simulators and vendors, which nothing here reads.
pub(super) fn with_prefixes(text: &str) -> Cow<'_, str> {
    let mut text = Cow::Borrowed(text.trim_start_matches('\u{feff}'));
    for _ in 0..MAX_PREFIXES {
        let Err(roxmltree::Error::UnknownNamespace(prefix, _)) = Document::parse(&text) else {
            break;
        };
        let Some(at) = text.find("<robot").map(|at| at + "<robot".len()) else { break };
        // On the same line, so that messages name the right one.
        text.to_mut().insert_str(at, &format!(" xmlns:{prefix}='undeclared-{prefix}'"));
    }
    text
}

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
    let is_macro = |node: &Node<'_>| {
        node.tag_name().namespace().is_some_and(|name| name.contains("xacro"))
            || node.attributes().any(|it| it.value().contains("${"))
    };
    // What simulators add is theirs.
    let mut read = root.children().filter(|it| it.tag_name().name() != "gazebo");
    match read.find_map(|child| child.descendants().find(is_macro)) {
        Some(node) => Err(fault(
            node,
            "a macro that is not expanded: expected the output of `xacro FILE > FILE.urdf`, found its input",
        )),
        None => Ok(root),
    }
}

/// The line on which an element begins, counted from 1.
pub(super) fn line_of(node: Node<'_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

/// The error `message` about an element, with its line and the link or joint that it belongs to.
pub(super) fn fault(node: Node<'_>, message: &str) -> Error {
    let tag = node.tag_name().name();
    let line = line_of(node);
    let owner = node.ancestors().find_map(|it| {
        let kind = it.tag_name().name();
        let name = it.attribute("name").filter(|_| ["link", "joint", "group"].contains(&kind))?;
        Some(format!("{kind} {}, ", quoted(name)))
    });
    Error::Robot(format!("{}<{tag:.60}> on line {line}: {message}", owner.unwrap_or_default()))
}

/// A name or value in quotes; of a long one the beginning and the end, which of a path says most.
pub(super) fn quoted(value: &str) -> String {
    let n_chars = value.chars().count();
    if n_chars <= MAX_QUOTED {
        return format!("'{value}'");
    }
    let head: String = value.chars().take(MAX_QUOTED / 3).collect();
    let tail: String = value.chars().skip(n_chars - 2 * MAX_QUOTED / 3).collect();
    format!("'{head}…{tail}'")
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
