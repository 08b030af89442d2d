//! Materials of glTF models: emission textures, two sets of coordinates, and extensions that are brought near.

use super::*;

/// A triangle with a material and images of one row each.
fn material(images: &[&[[u8; 4]]], material: Value) -> Case {
    Case::with(|c| {
        let image = |texels: &&[[u8; 4]]| {
            let bytes = png(texels, texels.len() as u32);
            json!({ "uri": format!("data:image/png;base64,{}", base64(&bytes)) })
        };
        c.document["images"] = images.iter().map(image).collect();
        c.document["textures"] = (0..images.len()).map(|i| json!({ "source": i })).collect();
        c.document["materials"][0] = material;
    })
}

#[test]
fn emission_textures_are_kept() {
    let emissive = json!({ "emissiveFactor": [1.0, 0.5, 1.0], "emissiveTexture": { "index": 0 } });
    let scene = material(&[&[[255, 0, 0, 255], [0, 0, 0, 255]]], emissive.clone()).load().unwrap();
    let m = &scene.materials[0];
    assert_eq!((m.emission, m.emission_texture), (Vec3::new(1.0, 0.5, 1.0), Some(0)));
    assert!(scene.textures[0].srgb && scene.ignored.is_empty(), "{:?}", scene.ignored);
    // u = 1/4 is the middle of the first texel.
    assert_eq!(scene.emission_at(&scene.triangles[0], [0.75, 0.25, 0.0]), Vec3::X);
    assert_eq!(scene.emission_at(&scene.triangles[0], [0.25, 0.75, 0.0]), Vec3::ZERO);

    // A black one emits nothing.
    let scene = material(&[&[[0, 0, 0, 255]]], emissive).load().unwrap();
    assert_eq!((scene.materials[0].emission, scene.materials[0].emission_texture), (Vec3::ZERO, None));
    assert!(scene.environment.is_some() && scene.emitters().is_empty());
}

#[test]
fn emission_without_a_strength_is_no_light_by_itself() {
    let plain = Case::new().load().unwrap();
    assert!(plain.emission_is_relative && plain.environment.is_some());
    let strong = Case::with(|c| {
        c.document["materials"][0]["extensions"] =
            json!({ "KHR_materials_emissive_strength": { "emissiveStrength": 1.0 } });
    });
    let strong = strong.load().unwrap();
    assert!(!strong.emission_is_relative && strong.environment.is_none());
    // A scene file that gives the radiance, or a sky, has the last word.
    let case = Case::new();
    case.load().unwrap();
    let description = |more: &str| {
        std::fs::write(case.path("a.toml"), format!("model = \"a.gltf\"\n{more}")).unwrap();
        scene::load(&case.path("a.toml")).unwrap().environment.map(|e| e.name.clone())
    };
    assert_eq!(description("").as_deref(), Some("overcast sky"));
    assert_eq!(description("[materials.lamp]\nemission = [1, 1, 1]"), None);
    assert_ne!(description("[environment]\nradiance = [0, 0, 0]").as_deref(), Some("overcast sky"));
}

#[test]
fn two_sets_of_texture_coordinates_are_read() {
    let transform = |offset: f32| json!({ "KHR_texture_transform": { "offset": [offset, 0.0] } });
    let case = |emission_offset: f32| {
        let mut case = material(
            &[&[[255; 4]], &[[0, 128, 0, 255]]],
            json!({
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 0 },
                    "metallicRoughnessTexture": { "index": 1, "texCoord": 1, "extensions": transform(0.5) },
                },
                "normalTexture": { "index": 1, "texCoord": 1, "extensions": transform(0.5) },
                "emissiveFactor": [1, 1, 1],
                "emissiveTexture": { "index": 0, "texCoord": 1, "extensions": transform(emission_offset) },
            }),
        );
        let uvs = [0.25f32, 0.0, 0.5, 0.25, 0.75, 1.0];
        let second = view(&mut case, &uvs.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>(), None);
        case.document["accessors"].as_array_mut().unwrap().push(json!({
            "bufferView": second, "componentType": 5126, "count": 3, "type": "VEC2",
        }));
        // The first of two primitives has another material, with one set.
        let mut plain = case.document["meshes"][0]["primitives"][0].clone();
        plain["material"] = json!(1);
        case.document["materials"].as_array_mut().unwrap().push(json!({ "name": "plain" }));
        let primitives = case.document["meshes"][0]["primitives"].as_array_mut().unwrap();
        primitives[0]["attributes"]["TEXCOORD_1"] = json!(4);
        primitives.insert(0, plain);
        case.document["extensionsUsed"] = json!(["KHR_texture_transform"]);
        case.load().unwrap()
    };
    let scene = case(0.5);
    assert!(scene.ignored.is_empty(), "{:?}", scene.ignored);
    assert_eq!(scene.uvs[3..], [Vec2::ZERO, Vec2::X, Vec2::Y]);
    let second = [Vec2::new(0.75, 0.0), Vec2::new(1.0, 0.25), Vec2::new(1.25, 1.0)];
    assert_eq!(scene.second_uvs, [&[Vec2::ZERO; 3], &second[..]].concat());
    let of = |i: usize| scene.materials[scene.triangles[i].material as usize].second_uvs;
    assert_eq!([of(0), of(1)], [[false; 4], [false, true, true, true]]);
    assert_eq!(scene.uv_at(&scene.triangles[1], [0.5, 0.5, 0.0], TextureUse::Normal), Vec2::new(0.875, 0.125));
    assert_eq!(scene.uv_at(&scene.triangles[1], [0.5, 0.5, 0.0], TextureUse::Base), Vec2::new(0.5, 0.0));

    // A third is named, and the texture takes the first.
    let scene = case(0.25);
    assert_eq!(scene.ignored.len(), 1);
    assert!(scene.ignored[0].contains("third set of texture coordinates"), "{:?}", scene.ignored);
    assert_eq!(scene.materials[scene.triangles[1].material as usize].second_uvs, [false, true, true, false]);
}

#[test]
fn emission_textures_and_second_coordinates_are_exported() {
    let case = material(
        &[&[[255, 0, 0, 255], [0, 0, 255, 255]]],
        json!({
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "emissiveFactor": [1, 1, 1],
            "emissiveTexture": { "index": 0, "extensions": { "KHR_texture_transform": { "offset": [0.5, 0.0] } } },
        }),
    );
    let scene = case.load().unwrap();
    let path = case.path("out.gltf");
    let light = VirtualLight { position: Vec3::Z, normal: -Vec3::Z, power: Vec3::ONE, exponent: 1.0 };
    export_lights(&path, &scene, &[light]).unwrap();
    let back = scene::load(&path).unwrap();
    assert_eq!((&back.uvs, &back.second_uvs), (&scene.uvs, &scene.second_uvs));
    assert_eq!(back.materials[0], scene.materials[0]);
}

#[test]
fn other_lobes_are_brought_near_and_named() {
    let load = |name: &str, extension: Value, roughness: f32, metallic: f32| {
        let pbr =
            json!({ "roughnessFactor": roughness, "metallicFactor": metallic, "baseColorFactor": [0.5, 0.5, 0.5, 1] });
        let case = material(
            &[&[[255, 255, 255, 127], [0, 0, 0, 255]]],
            json!({ "pbrMetallicRoughness": pbr, "extensions": { name: extension } }),
        );
        let scene = case.load().unwrap();
        (scene.materials[0].clone(), scene.ignored.join(" "), scene.textures)
    };
    let coat = "KHR_materials_clearcoat";
    let coated = json!({ "clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.2 });
    let (m, named, _) = load(coat, coated.clone(), 0.8, 0.0);
    assert!(near(m.specular, Vec3::splat(0.04 + 0.04 * 0.96 * 0.96)) && m.roughness == 0.2, "{m:?}");
    assert!(named.contains("one lobe stands for coat and base"), "{named}");
    // A polished coat is a mirror over the base.
    let (m, ..) = load(coat, json!({ "clearcoatFactor": 1.0 }), 0.8, 0.0);
    assert_eq!((m.surface, m.base_color), (Surface::Mirror, Vec3::splat(0.5)));
    // Over metal, or rougher than the base: as without.
    for (metallic, roughness) in [(1.0, 0.8), (0.0, 0.1)] {
        let (m, named, _) = load(coat, coated.clone(), roughness, metallic);
        assert!((m.roughness, m.specular.x) == (roughness, 0.04) || near(m.specular, Vec3::splat(0.04)), "{m:?}");
        assert!(named.contains(coat), "{named}");
    }
    assert_eq!(load(coat, json!({}), 0.8, 0.0).1, "");

    let brushed = json!({ "anisotropyStrength": 0.8, "anisotropyRotation": 0.5 });
    let (m, named, _) = load("KHR_materials_anisotropy", brushed.clone(), 0.5, 1.0);
    assert_eq!((m.roughness, m.anisotropy, m.anisotropy_rotation, named.as_str()), (0.5, 0.8, 0.5, ""));
    let mut textured = brushed;
    textured["anisotropyTexture"] = json!({ "index": 0 });
    let (m, named, _) = load("KHR_materials_anisotropy", textured, 0.5, 1.0);
    assert!(m.anisotropy == 0.8 && named.contains("the texture of KHR_materials_anisotropy"), "{named}");

    let old = json!({
        "diffuseFactor": [0.5, 0.25, 0.125, 1.0], "specularFactor": [0.2, 0.4, 0.6], "glossinessFactor": 0.5,
    });
    let glossiness = "KHR_materials_pbrSpecularGlossiness";
    let (m, named, _) = load(glossiness, old.clone(), 1.0, 1.0);
    assert_eq!((m.metallic, m.roughness, m.specular), (0.0, 0.5, Vec3::new(0.2, 0.4, 0.6)));
    assert!(near(m.base_color, Vec3::new(0.5, 0.25, 0.125)) && named.contains(glossiness), "{m:?} {named}");
    let mut textured = old;
    textured["specularGlossinessTexture"] = json!({ "index": 0 });
    let (m, _, textures) = load(glossiness, textured, 1.0, 1.0);
    // The mean of white and black; roughness 1 - 0.5 alpha.
    assert!(near(m.specular, Vec3::new(0.1, 0.2, 0.3)), "{}", m.specular);
    let roughness = &textures[m.metallic_roughness_texture.unwrap() as usize];
    assert_eq!((roughness.texels[0][1], roughness.texels[1][1], roughness.srgb), (192, 128, false));
    let missing = load_error(json!({ "diffuseTexture": { "index": 7 } }));
    assert!(missing.contains("texture 7"), "{missing}");

    /// The message for a material of specular colour and glossiness.
    fn load_error(extension: Value) -> String {
        let case = material(&[], json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": extension } }));
        case.load().unwrap_err().to_string()
    }
}
