"""The bus. Only this package imports Zenoh."""
