//! Triangles of mesh files: STL, binary and ASCII, OBJ and COLLADA.
//!
//! Only positions and faces are read; normals, colours and textures are ignored. Of COLLADA the unit
//! and the placement of geometry in the scene count, and the direction that it calls up does not, as
//! in the viewers of ROS.

use super::Result;
use super::xml::{MAX_LENGTH, decode_xml, quoted};
use glamx::DVec3;
use std::collections::BTreeSet;

/// Corners of a triangle, metres.
pub type Triangle = [DVec3; 3];

/// Reads a mesh by the file name that stands in the description; `None` when there is no such file.
///
/// Meshes out of memory, and what is said of one that is not there:
///
/// ```
/// use lpr_core::robot::Robot;
///
/// let meshes = |name: &str| (name == "hand.obj").then(|| b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n".to_vec());
/// let urdf = |file: &str| {
///     format!(
///         r#"<robot name="hand"><link name="base"/>
///         <link name="hand"><collision><geometry><mesh filename="{file}"/></geometry></collision></link>
///         <joint name="turn" type="continuous"><parent link="base"/><child link="hand"/></joint></robot>"#
///     )
/// };
/// let hand = Robot::from_urdf(&urdf("hand.obj"), None, None, &meshes)?;
/// assert!(!hand.links[1].spheres.is_empty());
/// let error = Robot::from_urdf(&urdf("claw.obj"), None, None, &meshes).unwrap_err();
/// assert!(error.to_string().contains("link 'hand', <mesh> on line 2: there is no mesh 'claw.obj'"));
/// # Ok::<(), lpr_core::Error>(())
/// ```
pub type MeshReader<'a> = dyn Fn(&str) -> Option<Vec<u8>> + 'a;

/// Bytes of a binary STL before its triangles: a header and their number.
const STL_HEAD: usize = 84;
/// Bytes of a triangle of a binary STL: normal, three corners, attribute count.
const STL_TRIANGLE: usize = 50;

/// The triangles of the mesh `file`, scaled along its axes; never none.
pub(super) fn read(
    file: &str,
    scale: DVec3,
    meshes: &MeshReader<'_>,
) -> Result<Vec<Triangle>, String> {
    let parse = parser(file)
        .ok_or_else(|| format!("mesh {} is neither STL, OBJ nor COLLADA", quoted(file)))?;
    let bytes = meshes(file).ok_or_else(|| format!("there is no mesh {}", quoted(file)))?;
    let in_file = |message: String| format!("mesh {}: {message}", quoted(file));
    let mut triangles = parse(&bytes).map_err(in_file)?;
    triangles.iter_mut().flatten().for_each(|corner| *corner *= scale);
    let is_broken = |triangle: &Triangle| {
        triangle
            .iter()
            .any(|corner| !(corner.abs().max_element() <= MAX_LENGTH && corner.is_finite()))
    };
    match triangles.iter().position(is_broken) {
        Some(i) => Err(in_file(format!(
            "triangle {i} has a corner that is not finite or further than {MAX_LENGTH} m away"
        ))),
        None if triangles.is_empty() => Err(in_file("it has no triangles".to_owned())),
        None => Ok(triangles),
    }
}

type Parser = fn(&[u8]) -> Result<Vec<Triangle>, String>;

/// By the end of the file's name.
fn parser(file: &str) -> Option<Parser> {
    let (_, ending) = file.rsplit_once('.')?;
    match ending.to_ascii_lowercase().as_str() {
        "stl" => Some(stl),
        "obj" => Some(obj),
        "dae" => Some(collada),
        _ => None,
    }
}

/// A binary file says how many triangles it has, and is exactly that long; some start with the word
/// of the ASCII form.
fn stl(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let announced = bytes
        .get(80..STL_HEAD)
        .map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let body = bytes.get(STL_HEAD..).unwrap_or_default();
    if announced
        .is_some_and(|n| n as usize == body.len() / STL_TRIANGLE && body.len() % STL_TRIANGLE == 0)
    {
        return Ok(body.chunks_exact(STL_TRIANGLE).map(stl_triangle).collect());
    }
    if bytes.trim_ascii_start().starts_with(b"solid") {
        return ascii_stl(&String::from_utf8_lossy(bytes));
    }
    Err(match announced {
        Some(n) => format!("{n} triangles announced, but {} bytes follow the head", body.len()),
        None => format!("{} bytes are too few for an STL file", bytes.len()),
    })
}

fn stl_triangle(bytes: &[u8]) -> Triangle {
    let float = |at: usize| {
        f64::from(f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
    };
    // The first 12 bytes are the normal.
    [12, 24, 36].map(|at| DVec3::new(float(at), float(at + 4), float(at + 8)))
}

fn ascii_stl(text: &str) -> Result<Vec<Triangle>, String> {
    let mut corners = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if let Some(rest) = line.trim_start().strip_prefix("vertex") {
            corners.push(
                position(rest)
                    .ok_or_else(|| format!("line {}: no corner: {}", i + 1, quoted(line)))?,
            );
        }
    }
    match corners.as_chunks::<3>() {
        (triangles, []) => Ok(triangles.to_vec()),
        _ => Err(format!("{} corners do not make whole triangles", corners.len())),
    }
}

/// By `mesh-loader`, which places a geometry once: a file that shows one twice would lose a part. It
/// applies the unit to corners but not to where they are placed, so that the unit is applied here.
fn collada(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let mut text = decode_xml(bytes).map_err(|error| error.to_string())?;
    let unit = take_unit(&mut text)?;
    let document = roxmltree::Document::parse(&text).map_err(|error| error.to_string())?;
    let mut shown = BTreeSet::new();
    for node in document.descendants().filter(|it| it.tag_name().name() == "instance_geometry") {
        let url = node.attribute("url").unwrap_or_default();
        if !shown.insert(url) {
            return Err(format!("geometry {} stands in the scene more than once", quoted(url)));
        }
    }
    let scene = mesh_loader::collada::from_str(&text).map_err(|error| error.to_string())?;
    let mut triangles = Vec::new();
    for mesh in &scene.meshes {
        let corner = |idx: u32| {
            let corner = mesh.vertices.get(idx as usize)?;
            Some(unit * DVec3::from_array(corner.map(f64::from)))
        };
        for &[a, b, c] in &mesh.faces {
            let corners = corner(a).zip(corner(b)).zip(corner(c));
            let ((a, b), c) =
                corners.ok_or_else(|| "a face has a corner that there is not".to_owned())?;
            triangles.push([a, b, c]);
        }
    }
    Ok(triangles)
}

/// The unit of a COLLADA file in metres, which is 1 in the text from then on.
fn take_unit(text: &mut String) -> Result<f64, String> {
    let document = roxmltree::Document::parse(text).map_err(|error| error.to_string())?;
    let unit = document.descendants().find(|it| it.tag_name().name() == "unit");
    let Some(meter) = unit.and_then(|it| it.attribute_node("meter")) else { return Ok(1.0) };
    let value = meter.value().trim().parse::<f64>().ok().filter(|it| it.is_finite() && *it > 0.0);
    let value = value.ok_or_else(|| format!("unit {} is no length", quoted(meter.value())))?;
    let range = meter.range_value();
    text.replace_range(range, "1");
    Ok(value)
}

/// The first three numbers of a line.
fn position(text: &str) -> Option<DVec3> {
    let mut numbers = text.split_whitespace().map(|word| word.parse().ok());
    Some(DVec3::new(numbers.next()??, numbers.next()??, numbers.next()??))
}

/// Polygons are cut into fans, which is exact for convex ones.
fn obj(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for (i, line) in String::from_utf8_lossy(bytes).lines().enumerate() {
        let wrong = |what: &str| format!("line {}: {what}: {}", i + 1, quoted(line));
        match line.trim_start().split_once([' ', '\t']) {
            Some(("v", rest)) => corners.push(position(rest).ok_or_else(|| wrong("no corner"))?),
            Some(("f", rest)) => {
                let polygon: Option<Vec<DVec3>> =
                    rest.split_whitespace().map(|word| corner_of(word, &corners)).collect();
                let polygon = polygon
                    .filter(|it| it.len() >= 3)
                    .ok_or_else(|| wrong("no face of corners before it"))?;
                triangles
                    .extend(polygon[1..].windows(2).map(|pair| [polygon[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    Ok(triangles)
}

/// The corner of `7`, `7/1`, `7//2` or `7/1/2`; negative numbers count from the last corner.
fn corner_of(word: &str, corners: &[DVec3]) -> Option<DVec3> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let idx = if number > 0 {
        number.checked_sub(1)?
    } else {
        number.checked_add(corners.len() as i64)?
    };
    (number != 0).then_some(())?;
    corners.get(usize::try_from(idx).ok()?).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_tests::mistake;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    const TETRAHEDRON: &str = "# four faces\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n\
                               f 1 3 2\nf 1/1 2/2 4/3\nf 1//1 4//2 3//3\nf -3 -2 -1\n";

    fn read_bytes(file: &str, bytes: &[u8]) -> Result<Vec<Triangle>, String> {
        read(file, DVec3::ONE, &|_| Some(bytes.to_vec()))
    }

    fn binary_stl(triangles: &[Triangle]) -> Vec<u8> {
        let mut bytes = b"solid by name only".to_vec();
        bytes.resize(80, b' ');
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in triangles {
            let corners = triangle.iter().flat_map(|corner| corner.to_array());
            let floats = [0.0; 3].into_iter().chain(corners);
            bytes.extend(floats.flat_map(|x| (x as f32).to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    /// Two triangles in centimetres, placed 10 cm up.
    const COLLADA: &str = r##"<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 100 0 0 0 100 0 0 0 100</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><matrix>1 0 0 0 0 1 0 0 0 0 1 10 0 0 0 1</matrix>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"##;

    #[test]
    fn collada_is_read_in_its_unit_and_where_its_scene_puts_it() {
        let found = read_bytes("a.DAE", COLLADA.as_bytes()).expect("two triangles");
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z + 0.1);
        let expected = [
            [at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0), at(0.0, 1.0, 0.0)],
            [at(0.0, 0.0, 0.0), at(0.0, 1.0, 0.0), at(0.0, 0.0, 1.0)],
        ];
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!(found.distance(*expected) < 1e-6, "{found} instead of {expected}");
        }
        assert_eq!(found.len(), 2);
        let twice = COLLADA.replace("</node>", "<instance_geometry url=\"#g\"/></node>");
        let error = read_bytes("a.dae", twice.as_bytes()).expect_err("a part would be lost");
        assert!(error.contains("'#g' stands in the scene more than once"), "{error}");
    }

    fn ascii_stl_of(triangles: &[Triangle]) -> Vec<u8> {
        let facet = |[a, b, c]: &Triangle| {
            let corners: String =
                [a, b, c].map(|p| format!("  vertex {} {} {}\n", p.x, p.y, p.z)).concat();
            format!("facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet\n")
        };
        format!("solid part\n{}endsolid part\n", triangles.iter().map(facet).collect::<String>())
            .into_bytes()
    }

    #[test]
    fn the_three_formats_read_the_same_triangles() {
        let triangles = read_bytes("a.obj", TETRAHEDRON.as_bytes()).expect("a tetrahedron");
        assert_eq!(triangles.len(), 4);
        assert_eq!(triangles[3], [DVec3::X, DVec3::Y, DVec3::Z]);
        assert_eq!(read_bytes("a.stl", &binary_stl(&triangles)).as_ref(), Ok(&triangles));
        assert_eq!(read_bytes("A.STL", &ascii_stl_of(&triangles)).as_ref(), Ok(&triangles));
    }

    #[test]
    fn a_quadrilateral_is_two_triangles_and_scale_is_along_the_axes() {
        let text = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
        let scale = DVec3::new(1.0, 2.0, -1.0);
        let found = read("a.obj", scale, &|_| Some(text.to_vec())).expect("a square");
        let corner = |x, y| DVec3::new(x, 2.0 * y, -0.0);
        assert_eq!(
            found,
            [
                [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0)],
                [corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]
            ]
        );
    }

    #[test]
    fn what_is_wrong_with_a_mesh_is_said() {
        let check = |file: &str, bytes: &[u8], expected: &str| {
            let message = read_bytes(file, bytes).expect_err(expected);
            assert!(message.contains(expected) && message.contains(file), "{message}");
        };
        check("a.ply", b"", "neither STL, OBJ nor COLLADA");
        check("a.dae", b"", "mesh 'a.dae'");
        check("a", b"", "neither STL, OBJ nor COLLADA");
        check("a.stl", b"", "too few");
        check("a.stl", &[0; 100], "0 triangles announced");
        check("a.stl", &binary_stl(&[]), "no triangles");
        check("a.stl", b"solid\nvertex 1 2 x\n", "line 2: no corner");
        check("a.stl", b"solid\nvertex 1 2 3\n", "whole triangles");
        check("a.stl", b"solid\nvertex 1 2 3\nvertex 1 2 NaN\nvertex 1 2 4", "not finite");
        check("a.obj", b"v 0 0 0\nv 0 0 2000\nf 1 2 1", "not finite or further");
        check("a.obj", b"v 1 2 3\nf 1 2 3\n", "line 2: no face");
        check("a.obj", b"v 1 2 3\nf 0 1 1\n", "line 2: no face");
        check("a.obj", b"v 1 2 3\nf 1 1\n", "line 2: no face");
        check("a.obj", b"v 1 2\n", "line 1: no corner");
        check("a.obj", b"", "no triangles");
        assert!(
            read("a.stl", DVec3::ONE, &|_| None)
                .is_err_and(|message| message.contains("no mesh 'a.stl'"))
        );
    }

    /// Text that is close to a mesh.
    fn near_mesh() -> impl Strategy<Value = Vec<u8>> {
        let word = prop_oneof![
            "v",
            "f",
            "solid",
            "vertex",
            "\n",
            "-?[0-9]{1,20}",
            "[0-9]/[0-9]",
            "nan",
            "inf",
            "-9223372036854775808",
            "\\PC"
        ];
        prop::collection::vec(word, 0..60).prop_map(|words| words.join(" ").into_bytes())
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_make_triangles_or_a_message(bytes in prop_oneof![prop::collection::vec(any::<u8>(), 0..400), near_mesh()]) {
            for file in ["a.stl", "a.obj"] {
                match read_bytes(file, &bytes) {
                    Ok(triangles) => prop_assert!(triangles.iter().flatten().all(|corner| corner.is_finite())),
                    Err(message) => prop_assert!(message.contains(file)),
                }
            }
        }

        #[test]
        fn a_binary_file_with_changed_or_missing_bytes_makes_triangles_or_a_message(
            at in any::<prop::sample::Index>(), byte in any::<u8>(), end in any::<prop::sample::Index>(),
        ) {
            let mut bytes = binary_stl(&[[DVec3::X, DVec3::Y, DVec3::Z]; 3]);
            let i = at.index(bytes.len());
            bytes[i] = byte;
            bytes.truncate(end.index(bytes.len() + 1));
            let read = read_bytes("a.stl", &bytes);
            prop_assert!(read.is_err_and(|message| message.len() > "mesh 'a.stl': ".len()) || bytes.len() == 84 + 150);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn a_mesh_with_one_mistake_makes_triangles_or_a_message_that_says_where(mistake in mistake()) {
            let triangles = read_bytes("a.obj", TETRAHEDRON.as_bytes()).expect("a tetrahedron");
            let files = [("a.obj", TETRAHEDRON.as_bytes()), ("a.stl", &ascii_stl_of(&triangles)), ("a.stl", &binary_stl(&triangles))];
            for (name, file) in files {
                match read_bytes(name, &mistake.made_in(file)) {
                    Ok(found) => prop_assert!(found.iter().flatten().all(|corner| corner.abs().max_element() <= MAX_LENGTH)),
                    Err(message) => {
                        let where_or_what = ["line ", "triangle", "corners", "too few"];
                        prop_assert!(message.contains(name) && where_or_what.iter().any(|it| message.contains(it)), "{message}");
                    }
                }
            }
        }
    }
}
