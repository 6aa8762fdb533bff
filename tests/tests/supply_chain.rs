//! What ends up in a build: locked, from the one registry, under licences this project can be combined with.

use meshband_tests::supply::{allowed_licences, bill_of_materials, checksums, metadata};

/// An SPDX expression is fine when one alternative of its OR is made of allowed licences only.
fn is_allowed(expression: &str, allowed: &[String]) -> bool {
    let plain = expression.replace(['(', ')'], "").replace('/', " OR ");
    plain.split(" OR ").any(|option| option.split(" AND ").all(|name| allowed.iter().any(|a| a == name.trim())))
}

#[test]
fn claim_every_dependency_is_locked_from_one_registry_and_permissive() {
    let (metadata, allowed) = (metadata().expect("locked"), allowed_licences().expect("a policy"));
    let packages = metadata["packages"].as_array().expect("a list of packages");
    assert!(packages.len() > 20, "the dependency graph was not read");
    let refused: Vec<String> = packages
        .iter()
        .filter_map(|package| {
            let licence = package["license"].as_str().unwrap_or("none stated");
            (!is_allowed(licence, &allowed)).then(|| format!("{}: {licence}", package["name"]))
        })
        .collect();
    assert!(refused.is_empty(), "licences to look at: {refused:?}");
    let mut sources: Vec<&str> = packages.iter().filter_map(|package| package["source"].as_str()).collect();
    sources.sort_unstable();
    sources.dedup();
    assert_eq!(sources.len(), 1, "{sources:?}");
    assert!(sources[0].starts_with("registry+"), "{sources:?}");
}

#[test]
fn claim_the_bill_of_materials_names_every_package_with_its_checksum() {
    let (metadata, checksums) = (metadata().expect("locked"), checksums().expect("a lock file"));
    let bill = bill_of_materials(&metadata, &checksums).expect("a bill");
    let components = bill["components"].as_array().expect("components");
    assert_eq!(components.len(), metadata["packages"].as_array().expect("packages").len());
    let hashed =
        components.iter().filter(|c| c["hashes"][0]["content"].as_str().is_some_and(|h| h.len() == 64)).count();
    let foreign = metadata["packages"].as_array().expect("packages").iter().filter(|p| p["source"].is_string()).count();
    // The workspace's own packages have no checksum.
    assert!(foreign > 20 && hashed == foreign, "{hashed} of {foreign}");
    assert!(bill["dependencies"].as_array().is_some_and(|d| d.len() == components.len()));
}

#[test]
fn theory_copyleft_and_missing_licences_are_refused() {
    let allowed = allowed_licences().expect("a policy");
    assert!(is_allowed("MIT OR Apache-2.0", &allowed));
    assert!(is_allowed("MIT OR GPL-3.0-only", &allowed));
    assert!(!is_allowed("GPL-3.0-only", &allowed));
    assert!(!is_allowed("MIT AND GPL-3.0-only", &allowed));
    assert!(!is_allowed("none stated", &allowed));
}
