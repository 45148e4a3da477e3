//! The surface of a link as triangles: whether it meets another, or holds it.

use crate::robot::{Link, PlacedSolid, Solid, Sphere};
use glamx::{DVec3, Pose3, Vec3};
use parry3d::bounding_volume::{Aabb, BoundingVolume as _};
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};

/// By how much boxes around triangles are larger, metres: rounding.
const MARGIN: f32 = 1e-5;

/// Corners of a triangle.
type Corners = [Vec3; 3];

/// Corners of each solid that are looked for in others.
const N_PROBES: usize = 8;

/// Triangles, a tree of boxes around them, and what is known of the inside.
#[derive(Debug)]
pub(in crate::scene) struct Surface {
    triangles: Vec<Corners>,
    tree: Bvh,
    /// Some corners of each solid.
    probes: Vec<Vec3>,
    /// The solids that are no meshes.
    solids: Vec<PlacedSolid>,
    /// Balls within the solids, of which meshes have no others.
    inside: Vec<Sphere>,
}

impl Surface {
    pub(super) fn of(link: &Link) -> Option<Self> {
        let placed = |it: &PlacedSolid| {
            let body_from_solid = it.body_from_solid;
            let place = move |corner: DVec3| (body_from_solid * corner).as_vec3();
            it.solid.surface().into_iter().map(move |corners| corners.map(place))
        };
        let (mut triangles, mut probes) = (Vec::new(), Vec::new());
        for solid in &link.solids {
            let first = triangles.len();
            triangles.extend(placed(solid));
            let step = (triangles.len() - first) / N_PROBES + 1;
            let corners = triangles[first..].iter().step_by(step);
            probes.extend(corners.map(|corners: &Corners| corners[0]));
        }
        let is_mesh = |it: &&PlacedSolid| matches!(it.solid, Solid::Mesh { .. });
        let solids = link.solids.iter().filter(|it| !is_mesh(it)).cloned().collect();
        // As deep as it reaches beyond the link.
        let deep = |it: Sphere| Sphere { radius: it.radius - link.overshoot, ..it };
        let inside = link.spheres_in_body().into_iter().map(deep);
        let inside = inside.filter(|it| it.radius > 0.0).collect();
        let boxes: Vec<Aabb> =
            triangles.iter().map(|corners| around(corners).loosened(MARGIN)).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        (!triangles.is_empty()).then_some(Self { triangles, tree, probes, solids, inside })
    }

    /// True if a triangle meets one of another surface, or one is within the other: a ball, box,
    /// cylinder or capsule, or deep in a mesh.
    pub(super) fn touches(&self, other: &Self, self_from_other: Pose3) -> bool {
        let are_near = |a: &BvhNode, b: &BvhNode| {
            a.aabb().intersects(&b.aabb().transform_by(&self_from_other))
        };
        let meet = self.tree.leaf_pairs(&other.tree, are_near).any(|(a, b)| {
            let b = other.triangles[b as usize].map(|corner| self_from_other * corner);
            triangles_meet(&self.triangles[a as usize], &b)
        });
        meet || self.holds(other, self_from_other) || other.holds(self, self_from_other.inverse())
    }

    /// True if the probes of another surface, which does not meet this one, are within it.
    fn holds(&self, other: &Self, self_from_other: Pose3) -> bool {
        other.probes.iter().map(|probe| self_from_other * *probe).any(|point| {
            let in_solid = |it: &PlacedSolid| {
                it.solid.contains(it.body_from_solid.inverse() * point.as_dvec3())
            };
            let in_ball = |it: &Sphere| it.center.distance_squared(point) < it.radius * it.radius;
            self.inside.iter().any(in_ball) || self.solids.iter().any(in_solid)
        })
    }
}

fn around(corners: &Corners) -> Aabb {
    let [a, b, c] = *corners;
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

/// True if two triangles have a point in common: they have not where an axis separates them, which
/// is normal to one of them, or to an edge of each, or to an edge in its plane.
///
/// By separating axes, since what GJK says in f32 of thin triangles is a touch too often.
fn triangles_meet(a: &Corners, b: &Corners) -> bool {
    // About one of them: differences of numbers that are alike.
    let a_in_f64 = a.map(|corner| (corner - a[0]).as_dvec3());
    let b_in_f64 = b.map(|corner| (corner - a[0]).as_dvec3());
    let edges = |[p, q, r]: [DVec3; 3]| [q - p, r - q, p - r];
    let (edges_a, edges_b) = (edges(a_in_f64), edges(b_in_f64));
    let (normal_a, normal_b) = (edges_a[0].cross(edges_a[1]), edges_b[0].cross(edges_b[1]));
    let across = edges_a.iter().flat_map(|edge| edges_b.map(|other| edge.cross(other)));
    let in_planes = (edges_a.map(|edge| edge.cross(normal_a)).into_iter())
        .chain(edges_b.map(|edge| edge.cross(normal_b)));
    let separates = |axis: DVec3| {
        let reach = |corners: [DVec3; 3]| {
            let along = corners.map(|corner| corner.dot(axis));
            (along[0].min(along[1]).min(along[2]), along[0].max(along[1]).max(along[2]))
        };
        let ((low_a, high_a), (low_b, high_b)) = (reach(a_in_f64), reach(b_in_f64));
        high_a < low_b || high_b < low_a
    };
    ![normal_a, normal_b].into_iter().chain(across).chain(in_planes).any(separates)
}

#[cfg(test)]
mod tests {
    use super::super::Geometry;
    use super::*;
    use crate::robot::Robot;
    use proptest::prelude::*;

    /// True if an edge of one goes through the other.
    fn edges_cross(a: &Corners, b: &Corners) -> bool {
        let goes_through = |from: Vec3, to: Vec3, [p, q, r]: &Corners| {
            let [from, to, p, q, r] = [from, to, *p, *q, *r].map(|it| it.as_dvec3());
            let side = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
            let sides = [side(from, to, p, q), side(from, to, q, r), side(from, to, r, p)];
            let are_across = side(p, q, r, from) * side(p, q, r, to) < 0.0;
            are_across && (sides.iter().all(|it| *it > 0.0) || sides.iter().all(|it| *it < 0.0))
        };
        let edges = |t: &Corners| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
        edges(a).iter().any(|(from, to)| goes_through(*from, *to, b))
            || edges(b).iter().any(|(from, to)| goes_through(*from, *to, a))
    }

    fn triangle() -> impl Strategy<Value = Corners> {
        let corner = || prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3::from_array);
        [corner(), corner(), corner()]
    }

    proptest! {
        #[test]
        fn triangles_meet_where_an_edge_goes_through_one(a in triangle(), b in triangle(), thin in 1e-3_f32..1.0) {
            let thinner = |[p, q, r]: Corners| [p, q, p + thin * (r - p)];
            let (a, b) = (thinner(a), thinner(b));
            prop_assert_eq!(triangles_meet(&a, &b), edges_cross(&a, &b));
        }
    }

    /// A base and a link that a joint moves along x, each with that geometry.
    fn pair(base: &str, moved: &str) -> (Geometry, Geometry) {
        let link = |name: &str, geometry: &str| {
            format!(
                r#"<link name="{name}"><collision><geometry>{geometry}</geometry></collision></link>"#
            )
        };
        let urdf = format!(
            r#"<robot name="pair">{}{}<joint name="j" type="prismatic"><parent link="a"/><child link="b"/>
            <axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>"#,
            link("a", base),
            link("b", moved),
        );
        let meshes = |_: &str| Some(CUBE.to_vec());
        let robot = Robot::from_urdf(&urdf, None, None, &meshes).expect("a sound description");
        let geometry = |link: usize| Geometry::of(&robot.links[link]).expect("geometry");
        (geometry(0), geometry(1))
    }

    /// Of 1 m, around the origin.
    const CUBE: &[u8] = b"v -.5 -.5 -.5\nv .5 -.5 -.5\nv -.5 .5 -.5\nv .5 .5 -.5\n\
        v -.5 -.5 .5\nv .5 -.5 .5\nv -.5 .5 .5\nv .5 .5 .5\n\
        f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n";

    #[test]
    fn links_touch_from_the_surface_to_the_inside_of_each_kind_of_solid() {
        /// Half the size of each.
        const REACH: f32 = 0.5;
        let solids = [
            r#"<sphere radius="0.5"/>"#,
            r#"<box size="1 1 1"/>"#,
            r#"<cylinder radius="0.5" length="1"/>"#,
            r#"<mesh filename="cube.obj"/>"#,
        ];
        let small = [r#"<sphere radius="0.05"/>"#, r#"<box size="0.1 0.1 0.1"/>"#];
        for solid in solids {
            for moved in small {
                let (a, b) = pair(solid, moved);
                let at = |x: f32| Pose3::from_translation(Vec3::new(x, 0.003, 0.002));
                for (x, touch) in [
                    (0.0, true),
                    (0.2, true),
                    (REACH, true),
                    (REACH + 0.048, true),
                    (REACH + 0.052, false),
                ] {
                    assert_eq!(
                        a.touches(Pose3::IDENTITY, &b, at(x)),
                        touch,
                        "{moved} in {solid} at {x}"
                    );
                    assert_eq!(
                        b.touches(at(x), &a, Pose3::IDENTITY),
                        touch,
                        "{moved} in {solid} at {x}"
                    );
                }
            }
        }
    }
}
