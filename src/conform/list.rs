//! The list of checks: of each the kernels, what it needs, how they are run, and the bound.

use super::Needs::{Clusters, Nothing};
use super::{Check, checks};

/// Calls a macro with all checks, by groups: the tests make one test of each.
#[doc(hidden)]
#[macro_export]
macro_rules! each_check {
    ($with:ident) => {
        $with! {
            kernels {
                upload_and_download_give_the_same_back("", Nothing, "copies between buffers", "exact");
                uploads_beyond_one_chunk_arrive_whole("", Nothing, "copies between buffers", "exact");
                a_dispatch_touches_its_elements_and_no_others("fill", Nothing, "copies between buffers", "exact");
                each_command_sees_what_those_before_it_wrote("fill", Nothing, "memory barriers, vkCmdUpdateBuffer", "exact");
                more_than_65535_workgroups_spread_over_two_axes("fill", Nothing, "workgroups along two axes", "exact");
                indirect_dispatches_take_their_size_from_a_buffer("fill", Nothing, "indirect dispatch", "exact");
                subgroups_workgroup_memory_and_atomics_work_at_any_subgroup_size("reduce", Nothing, "", "exact");
                images_are_written_and_copied_out("paint", Nothing, "copies from images", "exact");
            }
            sequences {
                sobol_points_of_a_shader_are_those_of_the_host("sobol_points", Nothing, "", "exact");
            }
            textures {
                lookups_follow_the_oracle_on_every_level_and_page("texture_samples", Nothing, "images of many layers, copies to images", "2e-4; 0.05 far from the origin");
            }
            film {
                accumulate_loses_nothing_over_thousands_of_passes("accumulate", Nothing, "", "1e-6 of each addend");
                accumulate_is_the_exact_sum("accumulate", Nothing, "", "exact");
                finite_counts_the_pixels_that_are_no_numbers("finite", Nothing, "", "exact");
                resolve_writes_the_mean_of_the_film("resolve", Nothing, "copies from images", "5e-7");
                probe_copies_the_sums_of_an_instance("probe", Nothing, "", "exact; shares 1e-3");
            }
            display {
                layers_are_those_of_files("layer", Nothing, "copies from images", "2e-5");
                a_display_shows_what_png_files_hold("layer display", Nothing, "copies from images", "one of 255 steps");
            }
            eye {
                camera_rays_trace_and_receivers_follow_their_oracles("camera_rays trace trace_cluster tiles_mark tiles_list eye_paths eye_points split_points schedule clusters_mark clusters_list clusters_fill", Nothing, "indirect dispatch", "1e-4");
                rays_through_surfaces_follow_their_oracles("camera_rays trace trace_cluster eye_paths eye_points split_points", Nothing, "indirect dispatch", "1e-4; 1 ray of 1000 may differ");
                emission_of_each_side("camera_rays trace trace_cluster eye_points", Nothing, "indirect dispatch", "exact");
                rays_carried_on_over_many_rounds_end_alike("trace trace_cluster shade shade_cluster schedule", Nothing, "indirect dispatch, state carried over dispatches", "exact");
            }
            paths {
                eye_paths_follow_their_oracle("eye_paths trace tiles_mark tiles_list", Nothing, "indirect dispatch", "directions 1e-3, densities of lobes 5e-3; 1 path of 1000 may differ");
                tiles_are_listed_in_order("tiles_mark tiles_list", Nothing, "", "exact");
                merge_adds_second_components_to_their_pixels("merge", Nothing, "indirect dispatch", "1e-6");
                third_components_join_second_ones("third_light", Nothing, "indirect dispatch", "1e-6");
                light_along_lobes_joins_its_pixel("glossy_light", Nothing, "indirect dispatch", "1e-5");
            }
            walk {
                walk_start_and_walk_reflect_follow_their_oracles("walk_start walk_follow walk_reflect trace", Nothing, "indirect dispatch", "2e-4; 1 of 1000 decisions may differ");
                the_walk_of_each_class_follows_its_oracles("walk_start walk_follow walk_reflect trace", Nothing, "indirect dispatch", "2e-4; 1 of 1000 decisions may differ");
                the_walk_from_an_environment_follows_its_oracles("walk_start walk_follow walk_reflect trace", Nothing, "indirect dispatch", "2e-4; 1 of 1000 decisions may differ");
                the_walk_against_the_oracle_path_by_path("walk_start walk_follow walk_reflect trace", Nothing, "indirect dispatch", "errors of sines, times 30 for each reflection; 3 lights of 1000 may differ");
            }
            delta_choice {
                delta_choice_follows_its_oracle("delta_choice", Nothing, "", "0.004 of each share");
            }
            importance {
                importance_follows_its_oracle_and_no_emitter_falls_below_the_floor("importance importance_scan", Nothing, "", "1e-3");
                where_nothing_is_seen_importance_goes_by_power("importance importance_scan", Nothing, "", "1e-6");
                particles_start_by_the_distribution_of_importance("importance importance_scan walk_start", Nothing, "", "2e-4");
            }
            light {
                shade_gather_and_collect_follow_their_oracles("shade shade_cluster gather near_aim near_aim_light gathered_points collect trace", Nothing, "indirect dispatch", "1e-4, lobes 2e-3; 1 of 1000 points may differ");
                surfaces_that_let_light_pass_follow_their_oracles("shade shade_cluster gather gathered_points collect trace", Nothing, "indirect dispatch", "1e-4, lobes 2e-3; 1 of 1000 points may differ");
                shade_of_each_kind_of_light("shade shade_cluster", Nothing, "indirect dispatch", "1e-4, lobes 2e-3; 1 of 1000 points may differ");
                schedule_turns_counts_into_dispatches("schedule", Nothing, "", "exact");
            }
            light_lists {
                clusters_choose_as_their_oracle("light_lists light_regions shade_cluster", Clusters, "indirect dispatch", "1e-3; 1 of 1000 lights may differ");
                classes_choose_by_power_where_there_are_no_clusters("light_lists shade", Nothing, "indirect dispatch", "1e-3; 1 of 1000 lights may differ");
            }
            photons {
                photons_follow_their_oracles("photon_lights photon_start photon_follow photon_radius photon_keys photon_cells photon_width photon_find photon_light sort_keys sort_count sort_scan sort_scatter", Nothing, "indirect dispatch", "1e-3; 1 photon of 1000 may differ; sorting exact");
                caustics_are_kept_out_of_the_filters("caustics_take caustics_add", Nothing, "", "exact");
                photons_from_an_environment_follow_their_oracles("photon_lights photon_start photon_follow photon_radius photon_keys photon_cells photon_width photon_find photon_light", Nothing, "indirect dispatch", "1e-3; 1 photon of 1000 may differ; sorting exact");
            }
            splats {
                splats_against_their_oracles("splat_start splat_follow splat_pack splat_keys splat_cells splat_width splat_find splat_light", Nothing, "indirect dispatch", "3e-3; 1 of 1000 may differ; sorting exact");
                a_batch_whose_hits_do_not_fit_is_left_out_whole("splat_pack", Nothing, "", "exact");
                each_class_of_pixels_takes_splats_in_one_of_as_many_passes("splat_find splat_light", Nothing, "indirect dispatch", "1e-4");
            }
            visibility {
                both_kernels_see_what_the_oracle_sees("visibility visibility_cluster", Nothing, "indirect dispatch", "20 rays of a million, and two");
                both_kernels_see_the_points_of_area_lights("visibility visibility_cluster", Nothing, "indirect dispatch", "20 rays of a million, and two");
                area_lights_on_surfaces_and_in_their_planes("visibility visibility_cluster", Nothing, "indirect dispatch", "2 rays of 1000, and two");
                degenerate_triangles_hide_no_area_light("visibility visibility_cluster", Nothing, "indirect dispatch", "two rays");
                tiny_area_lights_are_point_lights("visibility visibility_cluster", Nothing, "indirect dispatch", "20 rays of 67617");
                lights_at_vertices_and_on_surfaces("visibility visibility_cluster", Nothing, "indirect dispatch", "2 rays of 1000, and two");
                what_faces_away_is_culled_and_counted("counters", Clusters, "indirect dispatch", "exact");
            }
            traversal {
                clusters_see_what_single_rays_see("shade shade_cluster", Clusters, "indirect dispatch", "1e-4; 4 of 1000 pixels may differ");
                clusters_may_span_the_whole_scene("shade shade_cluster", Clusters, "indirect dispatch", "1e-4; 35 of 1000 pixels may differ");
                a_tree_that_outlasts_the_budget_is_finished_ray_by_ray("shade shade_cluster", Clusters, "indirect dispatch, state carried over dispatches", "1e-4; 10 of 1000 pixels may differ");
                clusters_pass_many_thin_veils_as_single_rays_do("shade shade_cluster", Clusters, "indirect dispatch", "1e-4; 10 of 1000 pixels may differ");
                lights_in_awkward_places("shade shade_cluster", Clusters, "indirect dispatch", "1e-4; 200 of 1000 pixels may differ");
                a_scene_of_one_triangle("shade shade_cluster", Clusters, "indirect dispatch", "1e-4; 4 of 1000 pixels may differ");
                lists_are_sorted_and_the_same_in_every_run("sort_keys sort_classes sort_count sort_scan sort_sum sort_scatter", Nothing, "indirect dispatch", "exact");
                clusters_of_the_screen_follow_their_oracle("clusters_mark clusters_list clusters_fill", Clusters, "indirect dispatch", "exact");
                both_orders_of_clusters_give_the_same_light("shade_cluster", Clusters, "indirect dispatch", "1e-5; 4 of 1000 pixels may differ");
            }
            discontinuity {
                discontinuity_follows_its_oracle("discontinuity discontinuity_guides", Nothing, "indirect dispatch", "1e-4");
                sparse_windows_follow_their_oracle("sparse_windows", Nothing, "indirect dispatch", "1e-4; 1 of 1000 pixels may differ");
                lobes_follow_their_oracle("discontinuity_lobes", Nothing, "indirect dispatch", "1e-4; 1 of 1000 pixels may differ");
            }
            near {
                near_light_follows_its_oracles("gather_near near_aim near_aim_light near_points near_spread near_collect near_add", Nothing, "indirect dispatch", "5e-4, sums 1e-5; 1 of 1000 rays may differ");
            }
            outliers {
                outliers_follow_their_oracle("outliers", Nothing, "indirect dispatch", "1e-3");
            }
            unlikely {
                unlikely_components_follow_their_oracle("unlikely", Nothing, "indirect dispatch", "1e-3");
            }
            gain {
                the_gain_is_what_the_filters_add("gain gain_paths", Nothing, "indirect dispatch", "1e-4");
            }
            edges {
                edges_follow_their_oracle("edges_mark edges_guide edges_rays edges_turn edges_light edges_add trace_edges", Nothing, "indirect dispatch", "2e-3; 1 of 1000 pixels may differ");
            }
            upsample {
                upsampling_follows_its_oracle("upsample", Nothing, "", "1e-3; 1 of 1000 pixels may differ");
                paths_of_pixels_follow_their_oracle("upsample_paths", Nothing, "indirect dispatch", "1e-3; 1 of 1000 points may differ");
            }
            lamp_edges {
                lamps_follow_their_oracle("lamp_edges_mark lamp_edges_rays lamp_edges_turn lamp_edges_add", Nothing, "indirect dispatch", "5e-3; 1 of 1000 rays may differ");
            }
            packed {
                packed_points_follow_their_oracle("unpack_points unpack_more", Nothing, "push constants of 128 bytes", "2e-6; 1 of 1000 points may differ");
            }
            convolve {
                convolve_follows_its_oracle("convolve convolve_mark convolve_list convolve_norms convolve_moments", Nothing, "indirect dispatch", "2e-4");
                regions_have_kernels_of_their_own("convolve convolve_tiles convolve_quads convolve_reduce convolve_weigh convolve_reach", Nothing, "indirect dispatch", "2e-4, and exact");
                convolve_fast_errs_little("convolve convolve_tiles convolve_quads convolve_reduce convolve_weigh convolve_reach", Nothing, "indirect dispatch", "0.001 to 0.06 by kernel");
                convolve_narrows_kernels_by_their_axes("convolve convolve_tiles convolve_quads convolve_reduce convolve_weigh", Nothing, "indirect dispatch", "2e-4; fast 0.01 to 0.1");
                convolve_keeps_constants_and_regions("convolve convolve_tiles convolve_quads convolve_reduce convolve_weigh", Nothing, "indirect dispatch", "1e-4");
                convolve_keeps_energy("convolve convolve_tiles convolve_quads convolve_reduce convolve_weigh", Nothing, "indirect dispatch", "1e-4; fast 0.02");
                convolve_by_nothing_is_the_mirror_image("convolve", Nothing, "indirect dispatch", "exact");
                convolve_takes_one_footprint_for_all("convolve", Nothing, "indirect dispatch", "exact");
                what_no_weight_reaches_keeps_its_own("convolve", Nothing, "indirect dispatch", "exact");
                convolve_gives_the_same_bits_again("convolve", Nothing, "indirect dispatch", "exact");
                layers_spread_over_each_other("convolve", Nothing, "indirect dispatch", "2e-4");
                what_lies_behind_stays_behind("convolve", Nothing, "indirect dispatch", "0.01");
                convolve_forgets_regions_that_have_moved("convolve convolve_mark convolve_list", Nothing, "indirect dispatch", "exact");
            }
        }
    };
}

macro_rules! list {
    ($($group:ident { $($name:ident($kernels:expr, $needs:expr, $host:expr, $bound:expr);)* })*) => {
        &[$($(Check {
            name: concat!(stringify!($group), "::", stringify!($name)),
            kernels: $kernels,
            needs: $needs,
            host: $host,
            bound: $bound,
            run: checks::$group::$name,
        },)*)*]
    };
}

/// All checks.
pub static ALL: &[Check] = each_check!(list);

/// Checks that end badly on purpose, each in another way.
pub static SELF_TESTS: &[Check] = list! {
    self_tests {
        a_broken_kernel_fails("broken_fill", Nothing, "", "exact");
        an_error_of_the_driver_is_one("", Nothing, "", "none");
        what_the_device_lacks_is_named("", Nothing, "", "none");
        a_crash_is_one("", Nothing, "", "none");
        what_does_not_end_is_ended("", Nothing, "", "none");
    }
};
