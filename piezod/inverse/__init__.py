"""A model file without a stage: voltages for positions, and code for other controllers.

`piezod.load_model` and `piezod voltages` compute what mode `feedforward` of the loop would write,
to the last bit, because they run the same compensator. `piezod export-code` writes the same inverse
as one file of C or MATLAB.
"""
