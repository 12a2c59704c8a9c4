from piezod.inverse.loaded_model import load_model as load_model

__version__: str

def build() -> str: ...
