"""Fields service: true gas and wind; `core.FieldsCore` is the participant that samples them."""
