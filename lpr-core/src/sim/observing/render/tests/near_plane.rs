//! A camera on the hand is close to things: triangles that cross its near plane are cut, not
//! dropped.

use super::*;
use crate::robot::{ROBOTS, Robot};
use parry3d::shape::Triangle;

/// The front sides that `camera` could see of `items`, in the world.
fn front_sides(renderer: &Renderer, items: &[Item], camera: &Camera) -> Vec<Triangle> {
    let eye = camera.world_from_camera.translation;
    let mut sides = Vec::new();
    for Item { mesh, world_from_mesh, .. } in items {
        let mesh = &renderer.meshes[mesh.0];
        for (corners, normal) in mesh.triangles.iter().zip(&mesh.normals) {
            let [a, b, c] = corners.map(|idx| *world_from_mesh * mesh.vertices[idx as usize]);
            if (world_from_mesh.rotation * *normal).dot(eye - a) > 0.0 {
                sides.push(Triangle::new(a, b, c));
            }
        }
    }
    sides
}

/// Depth of the nearest of `sides` behind the near plane on the ray through pixel `idx`.
fn nearest(camera: &Camera, idx: usize, sides: &[Triangle]) -> f32 {
    let image = pixel_center(camera, idx);
    let start = camera.unproject(image, camera.near);
    // Of depth 1, so that a distance along the ray is a depth.
    let ray = Ray::new(start, camera.unproject(image, 1.0) - camera.world_from_camera.translation);
    let hits = sides.iter().filter_map(|side| side.cast_local_ray(&ray, camera.far, false));
    hits.map(|distance| camera.near + distance).fold(View::NOTHING, f32::min)
}

/// Number of pixels that see something, and of those whose depth is not that of the ray.
fn compare_with_rays(renderer: &mut Renderer, items: &[Item], camera: &Camera) -> (usize, usize) {
    let view = renderer.render(camera, items).view;
    let sides = front_sides(renderer, items, camera);
    let is_wrong = |(idx, &depth): (usize, &f32)| {
        let expected = nearest(camera, idx, &sides);
        depth != expected && (depth - expected).abs() > 1e-4 * expected.max(0.1)
    };
    let n_seen = view.depth.iter().filter(|depth| depth.is_finite()).count();
    (n_seen, view.depth.iter().enumerate().filter(|pixel| is_wrong(*pixel)).count())
}

/// Number of triangles that reach from in front of the near plane to behind it.
fn n_crossing(renderer: &Renderer, items: &[Item], camera: &Camera) -> usize {
    let crosses = |side: &&Triangle| {
        let depths = [side.a, side.b, side.c]
            .map(|corner| camera.world_from_camera.inverse_transform_point(corner).z);
        depths.iter().any(|depth| *depth < camera.near)
            && depths.iter().any(|depth| *depth > camera.near)
    };
    front_sides(renderer, items, camera).iter().filter(crosses).count()
}

/// The wrist camera of an arm whose hand has come down, so that the camera is `height` metres over
/// the table.
fn low_wrist(robot: &Robot, height: f32) -> Camera {
    let mut camera = Camera::wrist(robot, &Pose3::from(robot.flange(&robot.start)));
    camera.world_from_camera.translation.z = height;
    camera
}

#[test]
fn a_table_that_crosses_the_near_plane_is_seen_where_rays_meet_it() {
    for (robot, height) in ROBOTS.into_iter().flat_map(|robot| [(robot, 0.009), (robot, 0.03)]) {
        let mut renderer = Renderer::new(Detail::Observation);
        let table = Item {
            mesh: renderer.mesh(&cuboid(0.6, 0.9, 0.05)).expect("a proper shape"),
            world_from_mesh: Pose3::translation(0.5, 0.0, -0.05),
            rgb: RED,
            id: 1,
        };
        let camera = low_wrist(robot, height).with_size(64, 64);
        let n_crossing = n_crossing(&renderer, &[table], &camera);
        assert!(n_crossing > 0, "{} at {height} m: nothing crosses the near plane", robot.name);
        let (n_seen, n_wrong) = compare_with_rays(&mut renderer, &[table], &camera);
        assert!(
            n_seen > 500 && n_wrong <= 2,
            "{} at {height} m: {n_wrong} wrong of {n_seen}",
            robot.name
        );
    }
}

#[test]
fn a_finger_one_centimetre_from_the_camera_is_cut_at_the_near_plane() {
    let mut renderer = Renderer::new(Detail::Observation);
    let camera = low_wrist(&PANDA, 0.2).with_size(64, 64);
    let finger = |x: f32, z: f32, tilt: f32| {
        let camera_from_finger =
            Pose3::from_parts(Vec3::new(x, 0.002, z), Quat::from_rotation_x(tilt));
        camera.world_from_camera * camera_from_finger
    };
    // Beside the axis from behind the eye to 3 cm before it; across the axis with its side at 1 cm;
    // one farther away.
    let poses = [finger(-0.012, 0.0, 0.0), finger(0.008, 0.018, 0.9), finger(0.0, 0.06, 0.3)];
    let mesh = renderer.mesh(&cuboid(0.006, 0.008, 0.03)).expect("a proper shape");
    let items = poses.map(|world_from_mesh| Item { mesh, world_from_mesh, rgb: RED, id: 1 });
    for shown in [&items[..1], &items[1..2], &items] {
        assert!(n_crossing(&renderer, shown, &camera) > 0);
        let (n_seen, n_wrong) = compare_with_rays(&mut renderer, shown, &camera);
        assert!(n_seen > 200 && n_wrong <= 2, "{n_wrong} wrong of {n_seen}");
    }
}
