"""Where inner names live that tests use: who moves one changes its line here, and no test.

    from tests.inner import Session

Laws and published numbers are tested by public names; what stands here is for tests of what no
public name shows, and may only become less (tests/test_doors.py). A name is looked up when a test
imports it. `alias=name` where two modules have the same name.
"""

from __future__ import annotations

from importlib import import_module

HOMES = {
    "": "version",
    "analysis": """
        asymmetry centres congruence deflection ellipsoids indices matrices metrics posture
        screws tolerances
    """,
    "analysis.asymmetry": "asymmetry_of",
    "analysis.centres": """
        centre_of_compliance centre_of_elasticity centre_of_stiffness normal_form
        point_of_least_coupling
    """,
    "analysis.deflection": "compliance_deflection displacement_of_point joint_shares",
    "analysis.ellipsoids": """
        Freedom MatrixPair Others compliance_block compliance_ellipsoid ellipsoid
        principal_pairs stiffness_block
    """,
    "analysis.indices": "isotropy",
    "analysis.matrices": """
        Definiteness ROTATION TRANSLATION loss_of_elimination move_compliance move_stiffness
        scale_lengths stiffnesses_of_motions with_angles_times
    """,
    "analysis.metrics": """
        characteristic_length inertia_metric length_from_inertia length_metric
        length_of_pair modes
    """,
    "analysis.parameters": "Parameters largest",
    "analysis.posture": "PostureMatrices Reading summarise",
    "analysis.principal": "block_ellipsoid",
    "analysis.screws": """
        SWAP_FORM screw_of_twist screw_of_wrench twist_compliant_axes wrench_compliant_axes
    """,
    "analysis.sections": "numbers unit_of",
    "analysis.tolerances": "Uncertain shares_of",
    "answer.better": "better_statements",
    "answer.doubts": "WEIGHTS doubts_of",
    "answer.equilibrium": "STABILITY",
    "answer.identify": "answer_of_identification",
    "answer.paths": "answer_of_compensation answer_of_curve answer_of_path",
    "answer.posture": "answer_at parts_of_links",
    "answer.reach": "answer_of_workspace",
    "answer.verdict": "RULES decide",
    "arrays": """
        arrays_Array=Array checked_array checked_pose checked_unit checked_vector csv_rows
        csv_text named_values plain real_array safe_cell unsafe_cell
    """,
    "batch": "kernels postures vibrations",
    "batch.algebra": """
        PLAIN algebra_congruence=congruence eliminated holds_soft_directions inverse
        positive_factor product reflections rotation_vector solution
    """,
    "batch.arguments": "OUTPUTS aligned_empty",
    "batch.chains": "deflection_for",
    "batch.execution": "CompiledKernel HELPERS PortableKernel PrintedPosture javascript",
    "batch.following": "Assembler",
    "batch.gradient": "gradient_program",
    "batch.kernels": "Closer WORTH_RECORDING",
    "batch.own_outputs": "OwnOutputs",
    "batch.plans": "plan program_for",
    "batch.quantities": "BUILT_IN FREQUENCIES Settings choose_quantities frequency_name",
    "batch.quick_poses": "QuickPoses",
    "batch.readings": "READINGS ascending eigenvalues largest_eigenvalue principal_values",
    "batch.recorded_postures": "RecordedPostures",
    "batch.recording": "Recording tensions_of_many",
    "batch.stacks": "evaluate needed_outputs",
    "batch.tape": "Number Tape absolute copysign cosine larger pick sine square_root",
    "batch.twists": "ForceField Kinematics",
    "batch.untraced": "segments_of_many strut_states",
    "batch.vibrations": "ManyModes",
    "child_process": "answer_of",
    "choices": "LOAD_KINDS",
    "cli": "analyse cli_identify=identify cli_modes=modes declare map options path reach tables",
    "cli.declare": "Command Overrides",
    "cli.main": "_COMMANDS command main",
    "cli.options": "Pairs Point Setup Values declared options_Number=Number",
    "cli.tables": "read_path_file",
    "cli.view": "Shown",
    "described": "SIGNS",
    "designs.run": "Design Designs StudyEvaluator",
    "designs.study": "Case Study read_study",
    "errors": "one_line printable",
    "expressions": "Expression",
    "figures": "figure_content new_figure",
    "geometry.charts": "Chart exponential product_of_exponentials",
    "geometry.connections": "Field flat",
    "geometry.se3": "adjoint exp log right_jacobian se3_inverse=inverse",
    "gradients": "gradients_matrices=matrices",
    "gradients.gradient": "gradient_Question=_Question",
    "gradients.matrices": "_Question",
    "gradients.objectives": "OfFunction OfQuantity",
    "identify.fitting": "linear_fit rates_by_step",
    "identify.identification": "with_result written_values",
    "identify.measurements": "DISPLACEMENT measurements_ROTATION=ROTATION table_text",
    "identify.models": "LoadedModel Model model_of",
    "identify.plan": "candidates information plan_plan=plan",
    "identify.unknowns": "unknowns_of",
    "identify.written_file": "_put_joints _yaml keys_to_write mechanism_file",
    "kinematics": "platform_assembly",
    "kinematics.architecture": "architecture_of orientation_rank",
    "kinematics.following": "Follower",
    "kinematics.joint_poses": """
        PlatformPoses distinct joint_poses_Kinematics=Kinematics pose_errors
    """,
    "kinematics.platform_assembly": "poses_of_lengths",
    "loading": """
        bare catalogue joints leg_schema loading_tables=tables mesh_worker meshes passes
        platform_schema readers ros schema urdf visuals xacro_worker yaml_file
    """,
    "loading.assembly": "Assembly Part",
    "loading.catalogue": "example_robot example_robots",
    "loading.description": "Lifted Obstacle",
    "loading.frames": "default_frame",
    "loading.joints": "cut",
    "loading.leg_schema": "ParallelFile",
    "loading.mesh_worker": "corner_normals",
    "loading.meshes": "read_meshes",
    "loading.mjcf": "reading worker",
    "loading.passes": "ASSUMED_STIFFNESS",
    "loading.platform_schema": "PlatformFile",
    "loading.published": "published_springs",
    "loading.readers": "read_robot_description",
    "loading.ros": "Ros",
    "loading.schema": "ClosedChainFile SerialFile",
    "loading.tables": "head_of read_rows",
    "loading.visuals": "visuals_of",
    "loading.yaml_file": "read_yaml",
    "maps": "cartesian described sampling store",
    "maps.job": "MapJob STATES",
    "maps.pictures": "histogram",
    "maps.reading": "state_names",
    "maps.run": "map_job packed part_elsewhere planned prepare_map run_map",
    "maps.sampling": "chunk_shape usual_chunk",
    "maps.store": "CHECKSUM MapFile",
    "matrix_names": "LETTERS",
    "mechanisms": "chain tree",
    "mechanisms.clearances": "distances_of_segments",
    "mechanisms.elements": "Elements",
    "mechanisms.flexible_links": "VIRTUAL",
    "mechanisms.identity": "_PARTS identity_of",
    "mechanisms.limits": "tensions_of",
    "mechanisms.tree": "TreeState",
    "mechanisms.tree_building": "merged tree_building_Give=Give",
    "notes": "DOUBTS Note assumed_stiffness",
    "numerics": "CONSTRAINT_TOLERANCE threads",
    "numerics.shortest": "shortest_above",
    "page": "export messages server source",
    "page.api": "Page StaticPage",
    "page.browser_program": "BrowserProgram browser_program",
    "page.export": "client_data export_page numbered",
    "page.files": "page_script page_style",
    "page.html_report": "report_page",
    "page.messages": """
        Answer Better Draw Frame LARGEST_MESSAGE Message Numbers Response ViewState
        read_message
    """,
    "page.picture": "PageScene",
    "page.report_drawing": "exaggerated",
    "page.server": "Background",
    "page.session": "Session",
    "page.shown": """
        describe_mechanism moved_part reference_frame series_row shown_numbers slider_ranges
        swept_range
    """,
    "page.source": "Cloud Playback Source cloud_of_workspace read_cloud read_trajectory",
    "potentials.beams": "stability_functions",
    "potentials.contract": "Posture evaluate_together",
    "potentials.functions": "TaylorCheck",
    "potentials.loads": "Scaled SemitangentialWrench",
    "potentials.mounted_struts": "MountedStruts",
    "reach": "assembly",
    "reach.workspace": "LegMargins Margins around carried lines_at wrench_margins",
    "report": "analysis",
    "report.analysis": "describe describe_equilibrium summary_text",
    "report.answer": "answer_text",
    "report.frames": "describe_frames frames_of",
    "report.layout": "percent",
    "report.maps": "map_section",
    "report.output": "save_figure write_json",
    "report.reach": "boundary_csv",
    "report.sentences": "SENTENCES TITLES VERDICTS answer_sentences direction_words "
    "share_words words_of",
    "results": "LabelledResult",
    "ros_packages": "package_folders search_path",
    "scene": "objects theme",
    "scene.environment": "scene_units",
    "scene.labels": "text_png",
    "scene.mechanism": "ChainPicture extent",
    "scene.objects": "rotation_to segment",
    "scene.points": "colours_of",
    "scene.scales": "Tension round_number",
    "scene.swing": "swing_of",
    "scene.theme": "COLOURS",
    "scene.viewer": "ViewerNode",
    "statics": "problem",
    "statics.problem": "System",
    "statics.small_motions": "spectrum_of",
    "stiffness": "compute motions posture_notes reduction",
    "stiffness.compute": "SCHEMA",
    "stiffness.forces": "used_shares",
    "stiffness.motions": "Problem _inverse decomposed motions_motions=motions",
    "stiffness.posture_notes": "error_of_soft_directions",
    "stiffness.reduction": "reduce_to",
    "toolpaths.better": "LoadedPostures better_posture",
    "toolpaths.optimise": "NEARBY Steps best_way criteria",
    "vibration.controllers": "double_diagonalisation square_root_damping",
    "vibration.response": "damping_matrix poles transmissibility",
    "vibration.sensitivities": "MATRICES",
    "writing": "create_folder write_whole",
}
_HOME = {
    word.partition("=")[0]: (module, word.rpartition("=")[2])
    for module, words in HOMES.items()
    for word in words.split()
}


def __getattr__(name: str) -> object:
    """The thing, from where it lives."""
    if name not in _HOME:
        raise AttributeError(name)
    inside, own = _HOME[name]
    module = import_module(f"cartstiff.{inside}" if inside else "cartstiff")
    try:
        return getattr(module, own)
    except AttributeError:
        return import_module(f"{module.__name__}.{own}")
