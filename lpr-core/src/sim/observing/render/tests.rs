//! The renderer against ray casting and against identities of the camera.

mod near_plane;

use super::*;
use crate::robot::PANDA;
use core::f32::consts::FRAC_PI_6;
use glamx::{Quat, Vec2};
use parry3d::query::{Ray, RayCast as _};
use parry3d::shape::{Cuboid, TriMesh};

const RED: [u8; 3] = [200, 40, 40];

fn cuboid(x: f32, y: f32, z: f32) -> Shape {
    Shape::Cuboid { half_extents: Vec3::new(x, y, z) }
}

/// A table with one of each shape, turned in different ways.
fn tabletop(renderer: &mut Renderer) -> Vec<Item> {
    let shapes = [
        (cuboid(0.5, 0.6, 0.02), Vec3::new(0.5, 0.0, -0.02)),
        (cuboid(0.04, 0.06, 0.05), Vec3::new(0.45, -0.15, 0.05)),
        (Shape::Sphere { radius: 0.05 }, Vec3::new(0.5, 0.1, 0.05)),
        (Shape::Cylinder { radius: 0.04, half_length: 0.07 }, Vec3::new(0.35, 0.2, 0.07)),
        (Shape::Capsule { radius: 0.06, half_length: 0.2 }, Vec3::new(0.1, 0.0, 0.35)),
        (Shape::Convex { points: wedge() }, Vec3::new(0.6, -0.05, 0.0)),
    ];
    let turn = |idx: usize| Quat::from_rotation_z(0.4 * idx as f32);
    let item = |(idx, (shape, position)): (usize, &(Shape, Vec3))| Item {
        mesh: renderer.mesh(shape).expect("a proper shape"),
        world_from_mesh: Pose3::from_parts(*position, turn(idx)),
        rgb: [40 * idx as u8, 120, 90],
        id: idx as u16 + 1,
    };
    shapes.iter().enumerate().map(item).collect()
}

fn wedge() -> Vec<Vec3> {
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z) * 0.08;
    [
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (1.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
        (0.0, 1.0, 1.0),
    ]
    .map(|(x, y, z)| corner(x, y, z))
    .to_vec()
}

/// A camera near the middle of the table.
fn close_up() -> Camera {
    Camera::looking_at("close", Vec3::new(0.9, -0.5, 0.4), Vec3::new(0.45, 0.0, 0.05), FRAC_PI_6)
}

/// All triangles of `items` in the world as one mesh of parry's.
fn merged(renderer: &Renderer, items: &[Item]) -> TriMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for item in items {
        let mesh = &renderer.meshes[item.mesh.0];
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices.iter().map(|&vertex| item.world_from_mesh * vertex));
        triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(|idx| idx + first)));
    }
    TriMesh::new(vertices, triangles).expect("triangles of proper meshes")
}

/// Depth that a ray through the centre of pixel `idx` meets, by `distance_along` a ray.
fn cast_depth(camera: &Camera, idx: usize, distance_along: impl Fn(&Ray) -> Option<f32>) -> f32 {
    let image = pixel_center(camera, idx);
    let origin = camera.world_from_camera.translation;
    let ray = Ray::new(origin, camera.unproject(image, 1.0) - origin);
    distance_along(&ray).filter(|&depth| depth <= camera.far).unwrap_or(View::NOTHING)
}

fn pixel_center(camera: &Camera, idx: usize) -> Vec2 {
    Vec2::new((idx % camera.width) as f32 + 0.5, (idx / camera.width) as f32 + 0.5)
}

/// Largest difference in depth where both see something, and the number of pixels where they differ
/// by more than 1e-4 m.
fn compare(view: &View, distance_along: impl Fn(&Ray) -> Option<f32>) -> (f32, usize) {
    let (mut most, mut n_others) = (0.0_f32, 0);
    for (idx, &depth) in view.depth.iter().enumerate() {
        let expected = cast_depth(&view.camera, idx, &distance_along);
        let difference = if depth == expected { 0.0 } else { (depth - expected).abs() };
        if difference > 1e-4 {
            n_others += 1;
        } else {
            most = most.max(difference);
        }
    }
    (most, n_others)
}

#[test]
fn depth_is_that_of_ray_casting() {
    let mut renderer = Renderer::new(Detail::Observation);
    let items = tabletop(&mut renderer);
    let mesh = merged(&renderer, &items);
    for camera in [Camera::front(&PANDA).unwrap(), close_up()] {
        let frame = renderer.render(&camera, &items);
        let n_seen = frame.view.depth.iter().filter(|depth| depth.is_finite()).count();
        let (most, n_others) =
            compare(&frame.view, |ray| mesh.cast_local_ray(ray, f32::MAX, false));
        assert!(n_seen > 4000, "{n_seen} pixels see something");
        assert!(
            n_others <= 2,
            "{n_others} pixels differ by more than 1e-4 m; others by at most {most} m"
        );
    }
}

#[test]
fn depth_of_a_box_is_that_of_the_exact_box() {
    let mut renderer = Renderer::new(Detail::Observation);
    let pose = Pose3::from_parts(
        Vec3::new(0.45, 0.0, 0.05),
        Quat::from_rotation_x(0.7) * Quat::from_rotation_z(0.3),
    );
    let mesh = renderer.mesh(&cuboid(0.05, 0.08, 0.03)).expect("a proper shape");
    let frame =
        renderer.render(&close_up(), &[Item { mesh, world_from_mesh: pose, rgb: RED, id: 7 }]);
    let exact = Cuboid::new(Vec3::new(0.05, 0.08, 0.03));
    let (most, n_others) = compare(&frame.view, |ray| exact.cast_ray(&pose, ray, f32::MAX, true));
    let n_seen = frame.mask.iter().filter(|&&id| id == 7).count();
    assert!(n_seen > 1000 && n_others <= n_seen / 500, "{n_others} of {n_seen} pixels differ");
    assert!(most < 1e-5, "{most} m");
}

#[test]
fn observation_meshes_are_at_most_six_percent_inside_a_ball() {
    let mut renderer = Renderer::new(Detail::Observation);
    let radius = 0.1;
    let mesh = renderer.mesh(&Shape::Sphere { radius }).expect("a proper shape");
    let center = Vec3::new(0.45, 0.0, 0.05);
    let item = Item { mesh, world_from_mesh: Pose3::from_translation(center), rgb: RED, id: 1 };
    let frame = renderer.render(&close_up(), &[item]);
    for (point, _) in frame.view.colored_points() {
        let distance = (point - center).length();
        assert!(distance < radius + 1e-5 && distance > radius * 0.94, "{distance}");
    }
}

#[test]
fn points_project_to_the_pixels_that_see_them() {
    let mut renderer = Renderer::new(Detail::Observation);
    let items = tabletop(&mut renderer);
    let View { camera, depth, points, .. } =
        renderer.render(&Camera::front(&PANDA).unwrap(), &items).view;
    for (idx, (point, depth)) in points.iter().zip(depth).enumerate() {
        assert_eq!(point.is_finite(), depth.is_finite());
        if !point.is_finite() {
            assert_eq!(*point, Vec3::INFINITY, "no NaN");
            continue;
        }
        let (image, seen_depth) = camera.project(*point).expect("in front of the camera");
        assert!((image - pixel_center(&camera, idx)).length() < 1e-2, "pixel {idx}: {image}");
        assert!((seen_depth - depth).abs() < 1e-5);
    }
}

#[test]
fn mask_colour_and_depth_belong_to_the_nearest_item() {
    let mut renderer = Renderer::new(Detail::Observation);
    let mesh = renderer.mesh(&cuboid(0.1, 0.1, 0.1)).expect("a proper shape");
    let at = |x: f32, id: u16| Item {
        mesh,
        world_from_mesh: Pose3::translation(x, 0.0, 0.0),
        rgb: [id as u8; 3],
        id,
    };
    let camera = Camera::looking("x", Vec3::ZERO, Vec3::X, FRAC_PI_6);
    let middle = camera.n_pixels() / 2 + camera.width / 2;
    for items in [[at(1.0, 100), at(2.0, 200)], [at(2.0, 200), at(1.0, 100)]] {
        let frame = renderer.render(&camera, &items);
        assert_eq!(frame.mask[middle], 100);
        assert!((frame.view.depth[middle] - 0.9).abs() < 1e-6);
        assert_eq!(frame.mask[0], NO_ITEM);
        assert_eq!(frame.view.depth[0], View::NOTHING);
        assert_eq!(frame.view.rgb[0], BACKGROUND);
    }
}

#[test]
fn faces_that_cross_the_near_plane_are_split() {
    let mut renderer = Renderer::new(Detail::Observation);
    // The eye is inside the box's outline seen from above, 2 cm over its top, which passes through
    // the near plane.
    let top = Item {
        mesh: renderer.mesh(&cuboid(2.0, 2.0, 0.1)).expect("a proper shape"),
        world_from_mesh: Pose3::translation(0.0, 0.0, -0.12),
        rgb: RED,
        id: 3,
    };
    let mut camera = Camera::looking("low", Vec3::ZERO, Vec3::new(1.0, 0.2, -0.3), 2.0);
    camera.near = 0.05;
    let frame = renderer.render(&camera, &[top]);
    let (mut n_seen, mut n_wrong) = (0, 0);
    for (idx, &depth) in frame.view.depth.iter().enumerate() {
        let ray = camera.unproject(pixel_center(&camera, idx), 1.0);
        // The ray meets the plane z = -0.02 at this depth, and the box's edge at 2 m cuts it off.
        let exact = -0.02 / ray.z;
        let hits = ray.z < 0.0
            && exact >= camera.near
            && (ray.x * exact).abs() < 2.0
            && (ray.y * exact).abs() < 2.0;
        n_seen += usize::from(hits);
        n_wrong += usize::from(
            hits != depth.is_finite() || (hits && (depth - exact).abs() > 1e-4 * exact),
        );
    }
    assert!(n_seen > 1000 && n_wrong <= n_seen / 200, "{n_wrong} of {n_seen}");
}

#[test]
fn an_eye_inside_a_mesh_sees_through_it() {
    let mut renderer = Renderer::new(Detail::Observation);
    let mesh = renderer.mesh(&cuboid(0.1, 0.1, 0.1)).expect("a proper shape");
    let around = Item { mesh, world_from_mesh: Pose3::IDENTITY, rgb: RED, id: 1 };
    let frame = renderer.render(&Camera::looking("in", Vec3::ZERO, Vec3::X, FRAC_PI_6), &[around]);
    assert!(frame.mask.iter().all(|&id| id == NO_ITEM));
}

#[test]
fn shared_edges_leave_no_gap() {
    let mut renderer = Renderer::new(Detail::Observation);
    let mesh = renderer.mesh(&Shape::Sphere { radius: 0.2 }).expect("a proper shape");
    let ball = Item { mesh, world_from_mesh: Pose3::IDENTITY, rgb: RED, id: 1 };
    for step in 0..20 {
        let camera =
            Camera::looking_at("near", Vec3::new(0.5, 0.013 * step as f32, 0.1), Vec3::ZERO, 0.3);
        let frame = renderer.render(&camera, &[ball]);
        assert!(frame.mask.iter().all(|&id| id == 1), "the ball fills the image, without holes");
    }
}

#[test]
fn a_reused_renderer_and_frame_give_the_same_picture() {
    let mut renderer = Renderer::new(Detail::Observation);
    let items = tabletop(&mut renderer);
    let first = renderer.render(&Camera::front(&PANDA).unwrap(), &items);
    let mut again = renderer.render(&Camera::front(&PANDA).unwrap(), &items[..2]);
    assert_ne!(first, again);
    renderer.render_into(&mut again, &items);
    assert_eq!(first, again);
    let mut other = Renderer::new(Detail::Observation);
    let items = tabletop(&mut other);
    assert_eq!(first, other.render(&Camera::front(&PANDA).unwrap(), &items));
}

#[test]
fn equal_shapes_share_a_mesh() {
    let mut renderer = Renderer::new(Detail::Observation);
    let first = renderer.mesh(&cuboid(0.1, 0.1, 0.1)).expect("a proper shape");
    let other = renderer.mesh(&cuboid(0.1, 0.1, 0.2)).expect("a proper shape");
    assert_eq!(first, renderer.mesh(&cuboid(0.1, 0.1, 0.1)).expect("a proper shape"));
    assert_ne!(first, other);
}

#[test]
fn image_widths_that_no_lane_count_divides_work() {
    let mut renderer = Renderer::new(Detail::Observation);
    let items = tabletop(&mut renderer);
    let mesh = merged(&renderer, &items);
    let frame = renderer.render(&close_up().with_size(61, 43), &items);
    let (_, n_others) = compare(&frame.view, |ray| mesh.cast_local_ray(ray, f32::MAX, false));
    assert!(n_others <= 2, "{n_others} pixels differ");
}
