"""Training of any network of ``export.models`` on a dataset of ``export.dataset``."""
