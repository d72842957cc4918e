"""The identification exercise: which features does each acceleration need?

basis_exercise, basis_recipe, basis_logs: its flights. basis_features, basis_model: its
models. basis_choice, basis_refinement, basis_study, basis_report: its answers.
"""
