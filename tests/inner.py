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
    "answer.analysis.matrices": """
        Definiteness loss_of_elimination stiffnesses_of_motions with_angles_times
    """,
    "answer.analysis.metrics": "modes",
    "answer.analysis.parameters": "largest",
    "answer.analysis.sections": "numbers unit_of",
    "answer.doubts": "WEIGHTS doubts_of",
    "answer.equilibrium": "STABILITY",
    "answer.posture": "answer_at",
    "answer.verdict": "RULES decide",
    "core.arrays": "safe_cell",
    "core.described": "SIGNS",
    "core.geometry.se3": "adjoint",
    "core.mechanisms": "chain tree",
    "core.numerics": "threads",
    "core.statics": "problem",
    "core.stiffness": "motions reduction",
    "core.stiffness.motions": "Problem _inverse motions_motions=motions",
    "files": """
        bare joints loading_tables=tables mesh_worker meshes passes readers urdf
        xacro_worker yaml_file
    """,
    "files.assembly": "Assembly Part",
    "files.catalogue": "example_robot example_robots",
    "files.child_process": "answer_of",
    "files.description": "Lifted Obstacle",
    "files.joints": "cut",
    "files.meshes": "read_meshes",
    "files.mjcf": "reading worker",
    "files.schema": "ClosedChainFile SerialFile",
    "files.tables": "head_of read_rows",
    "files.visuals": "visuals_of",
    "kinematics.joint_poses": "distinct joint_poses_Kinematics=Kinematics pose_errors",
    "recorded": "kernels postures vibrations",
    "recorded.algebra": """
        PLAIN algebra_congruence=congruence eliminated holds_soft_directions inverse
        positive_factor product reflections rotation_vector solution
    """,
    "recorded.arguments": "aligned_empty",
    "recorded.chains": "deflection_for",
    "recorded.execution": "CompiledKernel HELPERS PortableKernel PrintedPosture javascript",
    "recorded.following": "Assembler",
    "recorded.gradient": "gradient_program",
    "recorded.gradients": "gradients_matrices=matrices",
    "recorded.gradients.gradient": "gradient_Question=_Question",
    "recorded.gradients.objectives": "OfFunction OfQuantity",
    "recorded.kernels": "Closer",
    "recorded.own_outputs": "OwnOutputs",
    "recorded.plans": "plan program_for",
    "recorded.quantities": "BUILT_IN FREQUENCIES Settings choose_quantities frequency_name",
    "recorded.quick_poses": "QuickPoses",
    "recorded.readings": "READINGS ascending eigenvalues largest_eigenvalue principal_values",
    "recorded.recorded_postures": "RecordedPostures",
    "recorded.recording": "Recording",
    "recorded.stacks": "evaluate needed_outputs",
    "recorded.tape": "Number Tape absolute copysign cosine larger pick sine square_root",
    "recorded.twists": "ForceField Kinematics",
    "recorded.untraced": "segments_of_many strut_states",
    "recorded.vibrations": "ManyModes",
    "shown.cli": """
        analyse cli_identify=identify cli_modes=modes declare map options path reach
        tables
    """,
    "shown.cli.declare": "Command Overrides",
    "shown.cli.main": "_COMMANDS command",
    "shown.cli.options": "Pairs Point Setup Values declared options_Number=Number",
    "shown.cli.tables": "read_path_file",
    "shown.cli.view": "Shown",
    "shown.page": "messages server source",
    "shown.page.browser_program": "BrowserProgram browser_program",
    "shown.page.export": "client_data export_page numbered",
    "shown.page.files": "page_script page_style",
    "shown.page.following": "Follower",
    "shown.page.html_report": "report_page",
    "shown.page.messages": "ViewState read_message",
    "shown.page.report_drawing": "exaggerated",
    "shown.page.server": "Background",
    "shown.page.session": "Session",
    "shown.page.shown": "moved_part series_row shown_numbers",
    "shown.page.source": "Cloud Playback Source cloud_of_workspace read_cloud read_trajectory",
    "shown.report.analysis": "describe describe_equilibrium summary_text",
    "shown.report.answer": "answer_text",
    "shown.report.layout": "percent",
    "shown.report.sentences": "SENTENCES TITLES VERDICTS answer_sentences direction_words words_of",
    "shown.scene": "objects theme",
    "shown.scene.environment": "scene_units",
    "shown.scene.labels": "text_png",
    "shown.scene.mechanism": "extent",
    "shown.scene.objects": "rotation_to segment",
    "shown.scene.points": "colours_of",
    "shown.scene.scales": "Tension round_number",
    "shown.scene.swing": "swing_of",
    "shown.scene.theme": "COLOURS",
    "shown.scene.viewer": "ViewerNode",
    "wings.identify.answer": "answer_of_identification",
    "wings.identify.fitting": "linear_fit rates_by_step",
    "wings.identify.identification": "written_values",
    "wings.identify.measurements": "table_text",
    "wings.identify.models": "model_of",
    "wings.identify.plan": "information plan_plan=plan",
    "wings.identify.written_file": "_put_joints keys_to_write mechanism_file",
    "wings.maps": "cartesian described sampling store",
    "wings.maps.designs.run": "Design Designs StudyEvaluator",
    "wings.maps.designs.study": "Case Study read_study",
    "wings.maps.job": "MapJob STATES",
    "wings.maps.run": "map_job packed part_elsewhere planned prepare_map run_map",
    "wings.maps.store": "CHECKSUM MapFile",
    "wings.reach": "assembly platform_assembly",
    "wings.reach.answer": "answer_of_workspace",
    "wings.reach.architecture": "architecture_of orientation_rank",
    "wings.reach.platform_assembly": "poses_of_lengths",
    "wings.reach.workspace": "LegMargins around wrench_margins",
    "wings.toolpaths.answer": "answer_of_compensation answer_of_curve answer_of_path",
    "wings.toolpaths.better": "LoadedPostures better_posture",
    "wings.toolpaths.better_answer": "better_statements",
    "wings.toolpaths.optimise": "Steps best_way",
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
