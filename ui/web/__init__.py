"""The one public port: proxy to viser, access token, tiles, own pages."""
