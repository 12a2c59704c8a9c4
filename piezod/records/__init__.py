"""Records of runs: CSV and HDF5 in and out, figures, and the HTML report.

Nothing here knows how the data came about. Import the module you need: `csv_file` stays light,
`hdf5_file` brings h5py, `figures` and `report` bring matplotlib.
"""
