//! Geometry files: OBJ, STL and glTF, as triangles with the file's own material names.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DMat4, DVec3};

/// Most triangles of one file.
const MOST_TRIANGLES: usize = 5_000_000;

/// A file's triangles in its own units and axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct MeshFile {
    /// Corners of each triangle.
    pub(super) triangles: Vec<[DVec3; 3]>,
    /// Index in `names` of each triangle's material; `None`: the file names none.
    pub(super) materials: Vec<Option<usize>>,
    /// The file's material names in order of appearance.
    pub(super) names: Vec<String>,
    /// Whether the format defines y as up (glTF).
    pub(super) y_up: bool,
}

impl MeshFile {
    fn name_index(&mut self, name: &str) -> usize {
        self.names.iter().position(|known| known == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        })
    }

    fn push(&mut self, triangle: [DVec3; 3], material: Option<usize>) -> Result<(), String> {
        if self.triangles.len() >= MOST_TRIANGLES {
            return Err(format!("it has more than {MOST_TRIANGLES} triangles"));
        }
        if !triangle.iter().all(|corner| corner.is_finite()) {
            return Err("it has a corner that is not finite".to_owned());
        }
        self.triangles.push(triangle);
        self.materials.push(material);
        Ok(())
    }
}

/// Files already read; a sweep reads each file once.
#[derive(Debug, Default)]
pub(super) struct MeshFiles(Mutex<HashMap<PathBuf, Arc<MeshFile>>>);

impl MeshFiles {
    /// The triangles of a file.
    ///
    /// # Errors
    /// A sentence on what is wrong with the file, without its name.
    pub(super) fn get(&self, path: &Path) -> Result<Arc<MeshFile>, String> {
        // The map is valid at every moment, so a panic elsewhere while it was locked does no harm.
        let mut files = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = files.get(path) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(read(path)?);
        files.insert(path.to_owned(), Arc::clone(&file));
        Ok(file)
    }
}

/// Reads a geometry file by its extension.
fn read(path: &Path) -> Result<MeshFile, String> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let parse: fn(&[u8], &Path) -> Result<MeshFile, String> = match extension.as_str() {
        "obj" => |bytes, _| from_obj(bytes),
        "stl" => |bytes, _| from_stl(bytes),
        "gltf" | "glb" => from_gltf,
        _ => return Err(format!("`.{extension}` is not a known kind of geometry file, must be obj, stl, gltf or glb")),
    };
    let bytes = std::fs::read(path).map_err(|error| format!("cannot read it: {error}"))?;
    let file = parse(&bytes, path)?;
    if file.triangles.is_empty() {
        return Err("it has no triangles".to_owned());
    }
    Ok(file)
}

/// Wavefront OBJ. Faces may have any number of corners; materials are known by their `usemtl` names, no MTL file is read.
fn from_obj(bytes: &[u8]) -> Result<MeshFile, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is not UTF-8 text".to_owned())?;
    let mut mesh = MeshFile::default();
    for name in text.lines().filter_map(|line| line.trim().strip_prefix("usemtl")) {
        mesh.name_index(name.trim());
    }
    // The reader knows a material only after a library has defined it: define all names used in a library of ours.
    let library = |_: &Path| {
        let materials = mesh.names.iter().map(|name| tobj::Material { name: name.clone(), ..Default::default() });
        let indices = mesh.names.iter().enumerate().map(|(index, name)| (name.clone(), index));
        Ok((materials.collect(), indices.collect()))
    };
    let geometry: String =
        text.lines().filter(|line| !line.trim_start().starts_with("mtllib")).flat_map(|line| [line, "\n"]).collect();
    let with_library = format!("mtllib names\n{geometry}");
    let options = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(with_library), &options, library)
        .map_err(|error| format!("it is not a valid OBJ file: {error}"))?;
    for tobj::Model { mesh: part, .. } in models {
        let corner = |index: u32| -> Result<DVec3, String> {
            let start = index as usize * 3;
            match part.positions.get(start..start + 3) {
                Some(&[x, y, z]) => Ok(DVec3::new(f64::from(x), f64::from(y), f64::from(z))),
                _ => Err("a face uses a corner that does not exist".to_owned()),
            }
        };
        let mut rest = part.indices.as_slice();
        let mut arities = part.face_arities.iter();
        while !rest.is_empty() {
            // Without arities all faces are triangles.
            let arity = arities.next().map_or(3, |arity| *arity as usize);
            let Some((indices, behind)) = rest.split_at_checked(arity) else {
                return Err("its last face is incomplete".to_owned());
            };
            rest = behind;
            let corners = indices.iter().map(|index| corner(*index)).collect::<Result<Vec<_>, _>>()?;
            for triangle in triangulate(&corners)? {
                mesh.push(triangle, part.material_id)?;
            }
        }
    }
    Ok(mesh)
}

/// Triangles of a plane polygon, which may be concave.
fn triangulate(corners: &[DVec3]) -> Result<Vec<[DVec3; 3]>, String> {
    if let [a, b, c] = *corners {
        return Ok(vec![[a, b, c]]);
    }
    let ring: Vec<[f64; 3]> = corners.iter().map(|corner| corner.to_array()).collect();
    let mut plane = Vec::new();
    if !earcut::utils3d::project3d_to_2d(&ring, ring.len(), &mut plane) {
        return Ok(Vec::new());
    }
    let mut triangles: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(plane.iter().copied(), &[], &mut triangles);
    // Indices made by earcut are indices of the corners it was given.
    Ok(triangles
        .chunks_exact(3)
        .map(|t| [corners[t[0] as usize], corners[t[1] as usize], corners[t[2] as usize]])
        .collect())
}

/// STL, binary or text; the format knows no materials.
fn from_stl(bytes: &[u8]) -> Result<MeshFile, String> {
    let triangles = stl_io::create_stl_reader(&mut Cursor::new(bytes))
        .and_then(|reader| reader.take(MOST_TRIANGLES + 1).collect::<Result<Vec<_>, _>>())
        .map_err(|error| format!("it is not a valid STL file: {error}"))?;
    let mut mesh = MeshFile::default();
    for triangle in triangles {
        let corner = |v: stl_io::Vertex| DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]));
        mesh.push(triangle.vertices.map(corner), None)?;
    }
    Ok(mesh)
}

/// glTF 2.0: `.glb`, or `.gltf` with its buffers in files beside it.
fn from_gltf(bytes: &[u8], path: &Path) -> Result<MeshFile, String> {
    let invalid = |error: gltf::Error| format!("it is not a valid glTF file: {error}");
    let gltf::Gltf { document, mut blob } = gltf::Gltf::from_slice_without_validation(bytes).map_err(invalid)?;
    let root = document.into_json();
    // The validation of the library looks these up without a check of its own.
    let mut attributes = root.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|part| part.attributes.values());
    if attributes.any(|accessor| accessor.value() >= root.accessors.len()) {
        return Err("a mesh uses an accessor that does not exist".to_owned());
    }
    let document = gltf::Document::from_json(root).map_err(invalid)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().ok_or("its binary part is missing")?,
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                return Err("it has its buffer in the text; export it as .glb".to_owned());
            }
            gltf::buffer::Source::Uri(uri) => {
                let beside = path.parent().unwrap_or(Path::new("")).join(uri);
                std::fs::read(&beside)
                    .map_err(|error| format!("cannot read its buffer {}: {error}", beside.display()))?
            }
        };
        if data.len() < buffer.length() {
            return Err("its buffer is shorter than it says".to_owned());
        }
        buffers.push(data);
    }
    for view in document.views() {
        let end = view.offset().checked_add(view.length());
        if end.is_none_or(|end| buffers.get(view.buffer().index()).is_none_or(|buffer| end > buffer.len())) {
            return Err("a view reaches beyond its buffer".to_owned());
        }
    }
    let mut mesh = MeshFile { y_up: true, ..MeshFile::default() };
    let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else {
        return Err("it has no scene".to_owned());
    };
    for node in scene.nodes() {
        add_node(&node, DMat4::IDENTITY, &buffers, &mut mesh, 0)?;
    }
    Ok(mesh)
}

/// Adds a node's triangles and those of its children; `parent` places the node.
fn add_node(
    node: &gltf::Node<'_>,
    parent: DMat4,
    buffers: &[Vec<u8>],
    mesh: &mut MeshFile,
    depth: usize,
) -> Result<(), String> {
    if depth > 100 {
        return Err("its nodes are nested more than 100 deep".to_owned());
    }
    let place = parent * DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)));
    for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
        use gltf::mesh::Mode;
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            continue;
        }
        for (_, accessor) in primitive.attributes() {
            check_accessor(&accessor)?;
        }
        if let Some(accessor) = primitive.indices() {
            check_accessor(&accessor)?;
        }
        let material = primitive.material().name().map(|name| mesh.name_index(name));
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
        let Some(positions) = reader.read_positions() else { continue };
        let corners: Vec<DVec3> =
            positions.map(|p| place.transform_point3(DVec3::from_array(p.map(f64::from)))).collect();
        let indices: Vec<usize> = match reader.read_indices() {
            Some(indices) => indices.into_u32().map(|index| index as usize).collect(),
            None => (0..corners.len()).collect(),
        };
        let count = indices.len();
        let triples: Box<dyn Iterator<Item = [usize; 3]>> = match primitive.mode() {
            Mode::TriangleStrip => {
                Box::new((2..count).map(|i| if i % 2 == 0 { [i - 2, i - 1, i] } else { [i - 1, i - 2, i] }))
            }
            Mode::TriangleFan => Box::new((2..count).map(|i| [0, i - 1, i])),
            _ => Box::new((0..count / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2])),
        };
        for triple in triples {
            // Each place lies below `count` by construction.
            match triple.map(|place| corners.get(indices[place]).copied()) {
                [Some(a), Some(b), Some(c)] => mesh.push([a, b, c], material)?,
                _ => return Err("a triangle uses a corner that does not exist".to_owned()),
            }
        }
    }
    for child in node.children() {
        add_node(&child, place, buffers, mesh, depth + 1)?;
    }
    Ok(())
}

/// An accessor must stay within its view: the reader trusts it.
fn check_accessor(accessor: &gltf::Accessor<'_>) -> Result<(), String> {
    let Some(view) = accessor.view() else { return Ok(()) };
    let stride = view.stride().unwrap_or(accessor.size());
    let last = accessor.count().checked_sub(1).and_then(|steps| steps.checked_mul(stride));
    let end =
        last.and_then(|last| last.checked_add(accessor.size())).and_then(|end| end.checked_add(accessor.offset()));
    match end {
        Some(end) if end <= view.length() => Ok(()),
        _ => Err("an accessor reaches beyond its view".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &MeshFile) -> f64 {
        mesh.triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum()
    }

    #[test]
    fn obj_faces_keep_their_material_names_without_a_material_file() {
        let text = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nusemtl wood_panel\nf 1 2 3 4\nusemtl glass\nf 1 2 3\n";
        let mesh = from_obj(text.as_bytes()).expect("valid");
        assert_eq!(mesh.names, ["wood_panel", "glass"]);
        assert_eq!(mesh.materials, [Some(0), Some(0), Some(1)]);
        assert!((area(&mesh) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_concave_obj_face_keeps_its_area() {
        let text = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 2 0 4\nv 2 0 2\nv 0 0 2\nf 1 2 3 4 5 6\n";
        let mesh = from_obj(text.as_bytes()).expect("valid");
        // An L of 4 x 4 without a square of 2 x 2.
        assert!((area(&mesh) - 12.0).abs() < 1e-9, "{}", area(&mesh));
        assert_eq!(mesh.materials, [None; 4]);
    }

    #[test]
    fn stl_is_read_as_text_and_as_binary() {
        let text = b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
        assert!((area(&from_stl(text).expect("valid")) - 0.5).abs() < 1e-12);
        let mut binary = sample_stl();
        assert!((area(&from_stl(&binary).expect("valid")) - 0.5).abs() < 1e-12);
        binary.truncate(100);
        assert!(from_stl(&binary).is_err());
    }

    /// One triangle of area 1/2, doubled in size and moved by its node, of the material "wall".
    fn sample_glb() -> Vec<u8> {
        let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
            "nodes":[{"mesh":0,"translation":[10,0,0],"scale":[2,2,2]}],"materials":[{"name":"wall"}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],
            "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
            "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#;
        let mut json = json.as_bytes().to_vec();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut data = Vec::new();
        for number in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            data.extend(number.to_le_bytes());
        }
        let mut glb = b"glTF".to_vec();
        glb.extend(2u32.to_le_bytes());
        glb.extend((12 + 8 + json.len() as u32 + 8 + data.len() as u32).to_le_bytes());
        glb.extend((json.len() as u32).to_le_bytes());
        glb.extend(b"JSON");
        glb.extend(&json);
        glb.extend((data.len() as u32).to_le_bytes());
        glb.extend(b"BIN\0");
        glb.extend(&data);
        glb
    }

    #[test]
    fn glb_triangles_follow_their_node_and_material() {
        let mut glb = sample_glb();
        let mesh = from_gltf(&glb, Path::new("a.glb")).expect("valid");
        assert_eq!(mesh.names, ["wall"]);
        assert_eq!(mesh.triangles[0][0], DVec3::new(10.0, 0.0, 0.0));
        assert!((area(&mesh) - 2.0).abs() < 1e-6);
        // A view that reaches beyond the data is refused, not read.
        glb.truncate(glb.len() - 8);
        assert!(from_gltf(&glb, Path::new("a.glb")).is_err());
    }

    #[test]
    fn broken_files_say_so() {
        assert!(from_obj(b"v 0 0 0\nf 1 2 3\n").is_err());
        assert!(from_obj(b"\xff\xfe").is_err());
        assert!(from_gltf(b"not gltf", Path::new("a.gltf")).is_err());
    }

    fn sample_stl() -> Vec<u8> {
        let mut binary = vec![0u8; 80];
        binary.extend(1u32.to_le_bytes());
        for number in [0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            binary.extend(number.to_le_bytes());
        }
        binary.extend([0, 0]);
        binary
    }

    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(1), ..ProptestConfig::default() })]

        #[test]
        fn a_damaged_file_never_panics(places in prop::collection::vec((0.0..1.0f64, any::<u8>(), 0usize..3), 1..5)) {
            const OBJ: &[u8] = b"v 0 0 0\nv 4 0 0\nv 4 0 4\nv 2 0 4\nv 2 0 2\nvn 0 1 0\nusemtl a\nf 1//1 2//1 3//1 4//1\nf -1 -2 -3\ng b\nl 1 2\n";
            for (mut bytes, parse) in [
                (OBJ.to_vec(), (|bytes, _| from_obj(bytes)) as fn(&[u8], &Path) -> Result<MeshFile, String>),
                (sample_stl(), |bytes, _| from_stl(bytes)),
                (sample_glb(), from_gltf),
            ] {
                for (place, byte, kind) in &places {
                    let at = ((place * bytes.len() as f64) as usize).min(bytes.len().saturating_sub(1));
                    match kind {
                        0 if !bytes.is_empty() => bytes[at] = *byte,
                        1 => bytes.insert(at, byte % 64 + b' '),
                        _ => bytes.truncate(at),
                    }
                }
                let _ = parse(&bytes, Path::new("a.glb"));
            }
        }

        #[test]
        fn a_glb_with_other_numbers_in_its_text_never_panics(which in 0usize..100, number in "[0-9]{1,10}|-1|5121|5123|5125|5126") {
            let sample = sample_glb();
            // The text part starts at byte 20; its length stands in bytes 12 to 16.
            let length = u32::from_le_bytes([sample[12], sample[13], sample[14], sample[15]]) as usize;
            let text = String::from_utf8_lossy(&sample[20..20 + length]).into_owned();
            let digits: Vec<usize> = text.match_indices(|c: char| c.is_ascii_digit()).map(|(at, _)| at).collect();
            let at = digits[which % digits.len()];
            let mut json = format!("{}{number}{}", &text[..at], &text[at + 1..]).into_bytes();
            json.resize(json.len().next_multiple_of(4), b' ');
            let mut glb = sample[..8].to_vec();
            let rest = &sample[20 + length..];
            glb.extend((20 + json.len() as u32 + rest.len() as u32).to_le_bytes());
            glb.extend((json.len() as u32).to_le_bytes());
            glb.extend(b"JSON");
            glb.extend(json);
            glb.extend(rest);
            let _ = from_gltf(&glb, Path::new("a.glb"));
        }
    }
}
