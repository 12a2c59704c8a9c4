"""Records of runs: CSV and HDF5 input and output, figures, and the HTML report.

The package does not know how the data were measured. Import the module that you need: `csv_file` is
light, `hdf5_file` imports h5py, `figures` and `report` import matplotlib.
"""
