"""Parts for a machine: accuracy budget, catalogues, selection, sizing."""
