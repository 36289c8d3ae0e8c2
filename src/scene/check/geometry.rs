//! Boxes, walls and meshes.

use glam::{DVec2, DVec3};
use serde_spanned::Spanned;

use super::Surroundings;
use super::values::{FARTHEST_M, Limits, Names, choice, number_or, point};
use crate::error::{Result, Warning};
use crate::scene::locate::{Locator, hint_for};
use crate::scene::materials::Palette;
use crate::scene::mesh::MeshFile;
use crate::scene::polygon;
use crate::scene::room_file::{BoxTable, MeshTable, WallTable};
use crate::scene::{BoxRoom, Face, MaterialId, Mesh, Wall};

/// Shortest side of anything in m.
const SHORTEST_M: f64 = 1e-4;
/// How far corners may leave the common plane, and how near edges may come to each other, over the extent.
const PLANARITY: f64 = 1e-6;
/// Most corners of a wall.
const MOST_CORNERS: usize = 500;

/// Cuboid rooms.
pub(super) fn boxes(tables: &[Spanned<BoxTable>], palette: &mut Palette<'_>, at: &Locator<'_>) -> Result<Vec<BoxRoom>> {
    let mut names = Names::new("box", at);
    tables.iter().map(|table| one_box(table, &mut names, palette, at)).collect()
}

fn one_box(
    table: &Spanned<BoxTable>,
    names: &mut Names<'_>,
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
) -> Result<BoxRoom> {
    let typed = table.get_ref();
    let name = names.add(&typed.name)?;
    let min_m = point(&typed.min_m, "min_m", at)?;
    let max_m = point(&typed.max_m, "max_m", at)?;
    for axis in 0..3 {
        if max_m[axis] - min_m[axis] < SHORTEST_M {
            return Err(at.error(
                typed.max_m.span(),
                format!(
                    "box `{name}` goes from {} to {} m along {}, must be at least {SHORTEST_M} m long",
                    min_m[axis],
                    max_m[axis],
                    ["x", "y", "z"][axis]
                ),
                "min_m is the corner with the smallest coordinates, max_m that with the largest",
            ));
        }
    }
    let own = &typed.faces;
    let own = [&own.x_min, &own.x_max, &own.y_min, &own.y_max, &own.floor, &own.ceiling];
    let mut faces: [Option<MaterialId>; 6] = [None; 6];
    for (place, face) in Face::ALL.into_iter().enumerate() {
        faces[place] = match (own[place], &typed.material) {
            (Some(material), _) if material.get_ref() == "none" => None,
            (Some(material), _) | (None, Some(material)) => Some(palette.id(material)?),
            (None, None) => {
                return Err(at.error(
                    typed.name.span(),
                    format!("box `{name}` has no material for {}", face.name()),
                    "give it material = \"plaster\", or every face one in faces = { ... }",
                ));
            }
        };
    }
    if faces.iter().all(Option::is_none) {
        return Err(at.error(typed.name.span(), format!("box `{name}` has no face left"), "leave the box out"));
    }
    Ok(BoxRoom { name, min_m, max_m, faces })
}

/// Boxes that share more than a face are likely a slip.
pub(super) fn overlapping_boxes(boxes: &[BoxRoom], warnings: &mut Vec<Warning>) {
    for (i, a) in boxes.iter().enumerate() {
        for b in &boxes[i + 1..] {
            let common = a.max_m.min(b.max_m) - a.min_m.max(b.min_m);
            if common.min_element() > 1e-6 {
                warnings.push(Warning {
                    observation: format!(
                        "the boxes `{}` and `{}` overlap; their faces stand inside each other",
                        a.name, b.name
                    ),
                    remedy: "let them share a face at most, and remove that face with \"none\"".to_owned(),
                });
            }
        }
    }
}

/// Walls that cover each other in one plane are likely a slip.
pub(super) fn overlapping_walls(walls: &[Wall], warnings: &mut Vec<Warning>) {
    for (i, a) in walls.iter().enumerate() {
        for b in &walls[i + 1..] {
            let slack = 1e-6;
            let other: Vec<DVec3> = b.corners_m.iter().map(|corner| a.frame.local(*corner)).collect();
            let coplanar = other.iter().all(|corner| corner.z.abs() <= slack);
            let outline: Vec<DVec2> = other.iter().map(|corner| corner.truncate()).collect();
            if coplanar && (a.unbounded || b.unbounded || polygon::overlap(&a.outline_m(), &outline, slack)) {
                warnings.push(Warning {
                    observation: format!("the walls `{}` and `{}` lie over each other in one plane", a.name, b.name),
                    remedy: "make one wall of them, or let them share an edge only".to_owned(),
                });
            }
        }
    }
}

/// Polygons.
pub(super) fn walls(
    tables: &[Spanned<WallTable>],
    boxes: &[BoxRoom],
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
) -> Result<Vec<Wall>> {
    let mut names = Names::new("wall", at);
    tables
        .iter()
        .map(|table| {
            let name = &table.get_ref().name;
            let is_face = |room: &BoxRoom| {
                Face::ALL.iter().any(|face| format!("{}.{}", room.name, face.name()) == *name.get_ref())
            };
            if boxes.iter().any(is_face) {
                let message = format!("the wall name `{}` already means a face of a box", name.get_ref());
                return Err(at.error(name.span(), message, "give it another name"));
            }
            one_wall(table.get_ref(), &mut names, palette, at)
        })
        .collect()
}

fn one_wall(table: &WallTable, names: &mut Names<'_>, palette: &mut Palette<'_>, at: &Locator<'_>) -> Result<Wall> {
    let name = names.add(&table.name)?;
    let typed = &table.corners_m;
    let count = typed.get_ref().len();
    if !(3..=MOST_CORNERS).contains(&count) {
        return Err(at.error(
            typed.span(),
            format!("wall `{name}` has {count} corners, must have 3 to {MOST_CORNERS}"),
            "as corners_m = [[4, 0, 0], [4, 5, 0], [4, 5, 3], [4, 0, 3]]",
        ));
    }
    let corners_m = typed.get_ref().iter().map(|corner| point(corner, "a corner", at)).collect::<Result<Vec<_>>>()?;
    let low = corners_m.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = corners_m.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let extent = (high - low).length();
    for (i, (a, b)) in polygon::edges(&corners_m).enumerate() {
        let next = (i + 1) % count;
        if (b - a).length() < SHORTEST_M {
            return Err(at.error(
                typed.get_ref()[next].span(),
                format!(
                    "corners {} and {} of wall `{name}` coincide, must be at least {SHORTEST_M} m apart",
                    i + 1,
                    next + 1
                ),
                if next == 0 { "the polygon closes by itself: do not repeat the first corner" } else { "" },
            ));
        }
    }
    let frame =
        polygon::frame(&corners_m).filter(|_| polygon::newell(&corners_m).length() > PLANARITY * extent * extent);
    let Some(frame) = frame else {
        let message = format!("the corners of wall `{name}` enclose no area");
        return Err(at.error(typed.span(), message, "they lie on a line, or the outline crosses itself"));
    };
    let local: Vec<DVec3> = corners_m.iter().map(|corner| frame.local(*corner)).collect();
    // Planarity is judged against the mean plane: the frame's plane goes through corner 1.
    let mean = local.iter().map(|corner| corner.z).sum::<f64>() / count as f64;
    let worst = local.iter().enumerate().max_by(|(_, a), (_, b)| (a.z - mean).abs().total_cmp(&(b.z - mean).abs()));
    if let Some((i, corner)) = worst.filter(|(_, corner)| (corner.z - mean).abs() > PLANARITY * extent) {
        return Err(at.error(
            typed.get_ref()[i].span(),
            format!(
                "corner {} of wall `{name}` lies {:.3e} m beside the plane of the others, must be within {PLANARITY:e} of the wall's extent",
                i + 1,
                (corner.z - mean).abs()
            ),
            "split the wall into triangles",
        ));
    }
    let flat: Vec<DVec2> = local.iter().map(|corner| corner.truncate()).collect();
    if let Some((i, j)) = polygon::crossing(&flat, PLANARITY * extent) {
        return Err(at.error(
            typed.span(),
            format!("the outline of wall `{name}` touches or crosses itself: sides {} and {}", i + 1, j + 1),
            "give the corners in order round the outline",
        ));
    }
    let thickness_m = number_or(
        table.thickness_m.as_ref(),
        0.0,
        "thickness_m",
        Limits::Within(0.0, 10.0),
        "in metres, centred on the polygon",
        at,
    )?;
    let unbounded = table.unbounded.as_ref().is_some_and(|unbounded| *unbounded.get_ref());
    let material = palette.id_or_rigid(table.material.as_ref())?;
    Ok(Wall { name, corners_m, material, thickness_m, unbounded, frame })
}

/// Geometry from other files.
pub(super) fn meshes(
    tables: &[Spanned<MeshTable>],
    surroundings: &Surroundings<'_>,
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Mesh>> {
    tables.iter().map(|table| one_mesh(table.get_ref(), surroundings, palette, at, warnings)).collect()
}

fn one_mesh(
    table: &MeshTable,
    surroundings: &Surroundings<'_>,
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Mesh> {
    let name = table.file.get_ref();
    let file = surroundings.meshes.get(&surroundings.folder.join(name)).map_err(|what| {
        at.error(
            table.file.span(),
            format!("mesh `{name}`: {what}"),
            "the path starts from the folder of the room file",
        )
    })?;
    let scale =
        number_or(table.scale.as_ref(), 1.0, "scale", Limits::PositiveUpTo(1e6), "metres per unit of the file", at)?;
    let y_up = match &table.up {
        None => file.y_up,
        Some(up) => choice(up, "up", &[("y", true), ("z", false)], at)?,
    };
    let materials = mesh_materials(table, &file, palette, at)?;
    let turn = |p: DVec3| scale * if y_up { DVec3::new(p.x, -p.z, p.y) } else { p };
    let mut mesh = Mesh { file: name.into(), triangles_m: Vec::new(), materials: Vec::new() };
    for (triangle, material) in file.triangles.iter().zip(materials) {
        let [a, b, c] = triangle.map(turn);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        if [a, b, c].iter().any(|corner| corner.abs().max_element() > FARTHEST_M) {
            return Err(at.error(
                table.file.span(),
                format!("mesh `{name}` reaches farther than {FARTHEST_M} m from the origin"),
                "give metres per unit of the file as scale: 0.001 for millimetres",
            ));
        }
        // A sliver thinner than a millionth of its length has no direction of its own.
        if (b - a).cross(c - a).length() > 1e-6 * longest * longest {
            mesh.triangles_m.push([a, b, c]);
            mesh.materials.push(material);
        }
    }
    let dropped = file.triangles.len() - mesh.triangles_m.len();
    if mesh.triangles_m.is_empty() {
        return Err(at.error(table.file.span(), format!("mesh `{name}` has no triangle with an area"), ""));
    }
    if dropped > 0 {
        warnings.push(Warning {
            observation: format!(
                "mesh `{name}`: {dropped} of {} triangles have no area and are left out",
                file.triangles.len()
            ),
            remedy: "clean the mesh if the gaps matter".to_owned(),
        });
    }
    Ok(mesh)
}

/// The material of each triangle: `materials`, else a material of the same name, else `material`.
fn mesh_materials(
    table: &MeshTable,
    file: &MeshFile,
    palette: &mut Palette<'_>,
    at: &Locator<'_>,
) -> Result<Vec<MaterialId>> {
    let name = table.file.get_ref();
    for key in table.materials.keys() {
        if !file.names.contains(key.get_ref()) {
            return Err(at.error(
                key.span(),
                format!("mesh `{name}` has no material called `{}`", key.get_ref()),
                hint_for(key.get_ref(), "its materials", file.names.iter().map(String::as_str)),
            ));
        }
    }
    let mut by_name = Vec::with_capacity(file.names.len());
    for own in &file.names {
        by_name.push(match (table.materials.get(own.as_str()), &table.material) {
            (Some(material), _) => Some(palette.id(material)?),
            (None, _) if palette.has(own) => Some(palette.id(&Spanned::new(table.file.span(), own.clone()))?),
            (None, Some(material)) => Some(palette.id(material)?),
            (None, None) => None,
        });
    }
    let rest = table.material.as_ref().map(|material| palette.id(material)).transpose()?;
    file.materials
        .iter()
        .map(|own| {
            own.map_or(rest, |index| by_name[index]).ok_or_else(|| {
                let what = own.map_or("triangles without a material".to_owned(), |index| {
                    format!("the material `{}`", file.names[index])
                });
                at.error(
                    table.file.span(),
                    format!("mesh `{name}` has {what}, and nothing says what that is"),
                    "add materials = { ITS_NAME = \"plaster\" }, or material = \"plaster\" for all the rest",
                )
            })
        })
        .collect()
}
