# The materials that are built. Each has a header
# include/mpm/physics/material/<snake_case_name>.hpp; adding one here gives it an instantiation unit
# per backend.
set(MPM_MODELS TaitFluid HerschelBulkleyFluid FixedCorotated NeoHookean StVenantKirchhoffHencky
               LinearElastic VonMises DruckerPrager CamClay Hypoelastic)
